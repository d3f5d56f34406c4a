-- subjects: attempt
select rollout_id, group_id, 'rollouts' as "table", coalesce(
        case when effective_steer_rule <> steer_rule then 'effective_steer_rule' end,
        case when effective_steer_value is distinct from steer_value then 'effective_steer_value' end,
        case when effective_throttle_rule <> throttle_rule then 'effective_throttle_rule' end,
        case when effective_throttle_value is distinct from throttle_value then 'effective_throttle_value' end,
        case when effective_brake_rule <> brake_rule then 'effective_brake_rule' end,
        case when effective_brake_value is distinct from brake_value then 'effective_brake_value' end,
        case when effective_duration_ticks <> duration_ticks then 'effective_duration_ticks' end,
        case when effective_recovery <> recovery then 'effective_recovery' end
    ) as "column"
from attempt where "column" is not null
