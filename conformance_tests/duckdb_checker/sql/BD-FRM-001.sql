-- subjects: frames
select rollout_id, tick, 'frames' as "table", 'camera' as "column"
from frames where not list_contains($cameras, camera)
