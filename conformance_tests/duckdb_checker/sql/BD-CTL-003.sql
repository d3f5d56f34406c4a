-- subjects: attempt where role = 'intervention' and run in (select run from command where active and rule = 'online_expert')
select rollout_id, group_id, 'controls' as "table", min_by('intended_' || actuator, tick) as "column", min(tick) as tick
from command where active and role = 'intervention' and rule = 'online_expert' and intended <> expert
group by rollout_id, group_id
