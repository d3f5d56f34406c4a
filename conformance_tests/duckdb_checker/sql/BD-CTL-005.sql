-- subjects: attempt where 'zero' in (steer_rule, throttle_rule, brake_rule)
select rollout_id, group_id, 'controls' as "table", min_by('intended_' || actuator, tick) as "column", min(tick) as tick
from command where active and rule = 'zero' and intended <> 0
group by rollout_id, group_id
