-- subjects: attempt where 'stored_nominal' in (steer_rule, throttle_rule, brake_rule)
select rollout_id, group_id, 'controls' as "table", min_by('intended_' || actuator, tick) as "column", min(tick) as tick
from command where active and rule = 'stored_nominal' and intended <> nominal
group by rollout_id, group_id
