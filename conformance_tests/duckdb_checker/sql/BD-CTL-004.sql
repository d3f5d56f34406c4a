-- subjects: attempt where role = 'intervention' and run in (select run from command where active and rule = 'stored_nominal')
select rollout_id, group_id, 'controls' as "table", min_by('intended_' || actuator, tick) as "column", min(tick) as tick
from command where active and role = 'intervention' and rule = 'stored_nominal' and intended <> nominal
group by rollout_id, group_id
