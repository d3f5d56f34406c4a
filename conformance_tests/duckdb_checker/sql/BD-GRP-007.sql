-- subjects: compared_nominal
select group_id, rollout_id, 'rollouts' as "table", 'protocol_variant' as "column"
from chosen semi join examined_nominal using (group_id) where strange
qualify row_number() over (partition by group_id order by rollout_id) = 1
