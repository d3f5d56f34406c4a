-- subjects: attempt where role = 'intervention' and run in (select run from control where active)
select rollout_id, group_id, 'controls' as "table", min_by('applied_' || actuator, tick) as "column", min(tick) as tick
from command where active and role = 'intervention' and abs(applied::double - intended::double) > $actuator
group by rollout_id, group_id
