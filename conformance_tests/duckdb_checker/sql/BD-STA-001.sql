-- subjects: rollouts where rollout_id not in (select rollout_id from faulty)
select rollout_id, group_id, 'rollouts' as "table", 'status' as "column"
from rollouts where status <> 'complete' and rollout_id not in (select rollout_id from faulty)
