-- subjects: rollouts
select rollout_id, 'rollouts' as "table", 'rollout_id' as "column"
from rollouts where rollout_id is not null group by rollout_id having count(*) > 1
