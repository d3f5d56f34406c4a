-- subjects: frames
select shard, rollout_id, tick, camera, 'frames' as "table", 'camera' as "column"
from frames where not list_contains($cameras, camera)
