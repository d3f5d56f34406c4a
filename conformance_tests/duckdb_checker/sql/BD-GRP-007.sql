-- subjects: chosen_nominal
select group_id, rollout_id, 'rollouts' as "table", 'protocol_variant' as "column"
from chosen where strange and not faulty
qualify row_number() over (partition by group_id order by rollout_id) = 1
