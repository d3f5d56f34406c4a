-- subjects: compared_nominal
select distinct group_id
from chosen c join examined_nominal n using (group_id)
where c.role = 'intervention' and c.nominal_rollout_id <> n.rollout_id
