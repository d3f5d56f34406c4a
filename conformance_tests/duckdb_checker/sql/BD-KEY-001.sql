-- subjects: rollouts
select rollout_id, 'rollouts' as "table"
from rollouts where rollout_id is not null group by rollout_id having count(*) > 1
