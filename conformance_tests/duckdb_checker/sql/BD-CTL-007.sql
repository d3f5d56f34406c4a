-- subjects: attempt where 'floor' in (steer_rule, throttle_rule, brake_rule)
select rollout_id, group_id, 'controls' as "table", min_by('intended_' || actuator, tick) as "column", min(tick) as tick
from command where active and rule = 'floor' and intended <> greatest(expert, value)
group by rollout_id, group_id
