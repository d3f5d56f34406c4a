-- subjects: attempt where run in (select run from control where not active)
select rollout_id, group_id, 'controls' as "table", min_by('applied_' || actuator, tick) as "column", min(tick) as tick
from command where not active and abs(applied::double - expert::double) > $actuator
group by rollout_id, group_id
