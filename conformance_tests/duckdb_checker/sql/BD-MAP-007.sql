-- subjects: surveyed where run in (select run from limited where is_compared)
select rollout_id, group_id, 'observations' as "table", 'speed_limit_mps' as "column", min(tick) as tick
from limited where must and not may
group by rollout_id, group_id
