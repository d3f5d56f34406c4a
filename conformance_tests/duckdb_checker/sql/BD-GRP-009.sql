-- subjects: examined_nominal
select distinct group_id, 'observations' as "table"
from effect semi join examined_nominal using (group_id) where moves and (steers or drive <= -0.2) and first_difference is null
