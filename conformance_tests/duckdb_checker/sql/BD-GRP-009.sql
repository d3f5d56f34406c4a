-- subjects: chosen_nominal
select distinct group_id, 'observations' as "table"
from effect where moves and (steers or drive <= -0.2) and first_difference is null
