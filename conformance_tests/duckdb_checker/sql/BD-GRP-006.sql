-- subjects: attempt where role = 'nominal_replay'
select r.rollout_id, r.group_id, 'rollouts' as "table", coalesce(
        case when r.route_id is distinct from n.route_id then 'route_id' end,
        case when r.route_x_m is distinct from n.route_x_m then 'route_x_m' end,
        case when r.route_y_m is distinct from n.route_y_m then 'route_y_m' end,
        case when r.town is distinct from n.town then 'town' end,
        case when r.seed is distinct from n.seed then 'seed' end,
        case when r.repetition is distinct from n.repetition then 'repetition' end,
        case when r.branch_tick is distinct from n.branch_tick then 'branch_tick' end,
        case when r.branch_frame is distinct from n.branch_frame then 'branch_frame' end,
        case when r.trigger_definition is distinct from n.trigger_definition then 'trigger_definition' end,
        case when r.trigger_tick is distinct from n.trigger_tick then 'trigger_tick' end,
        case when r.trigger_signal is distinct from n.trigger_signal then 'trigger_signal' end,
        case when r.trigger_value is distinct from n.trigger_value then 'trigger_value' end,
        case when r.trigger_threshold is distinct from n.trigger_threshold then 'trigger_threshold' end,
        case when r.trigger_confidence is distinct from n.trigger_confidence then 'trigger_confidence' end,
        case when r.scenario_type is distinct from n.scenario_type then 'scenario_type' end,
        case when r.environment is distinct from n.environment then 'environment' end,
        case when r.ego_length_m is distinct from n.ego_length_m then 'ego_length_m' end,
        case when r.ego_width_m is distinct from n.ego_width_m then 'ego_width_m' end,
        case when r.ego_height_m is distinct from n.ego_height_m then 'ego_height_m' end
    ) as "column"
from attempt r join rollouts n on n.run = r.nominal_run
where r.role = 'nominal_replay' and "column" is not null
