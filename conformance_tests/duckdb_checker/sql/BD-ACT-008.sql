-- subjects: (select distinct run from braking)
-- Attempts whose slow ego brakes for pedestrians, none of whom has a row at any such observation.
select rollout_id, group_id, 'observations' as "table", 'pedestrian_hazard' as "column", min(tick) as tick
from braking group by run, rollout_id, group_id having not bool_or(is_there)
