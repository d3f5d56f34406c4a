-- subjects: compared_nominal
select c.group_id as group_id, c.rollout_id as rollout_id, 'rollouts' as "table", coalesce(
        case when c.branch_tick is distinct from n.branch_tick then 'branch_tick' end,
        case when c.branch_frame is distinct from n.branch_frame then 'branch_frame' end,
        case when c.trigger_definition is distinct from n.trigger_definition then 'trigger_definition' end,
        case when c.trigger_tick is distinct from n.trigger_tick then 'trigger_tick' end,
        case when c.trigger_signal is distinct from n.trigger_signal then 'trigger_signal' end,
        case when c.trigger_value is distinct from n.trigger_value then 'trigger_value' end,
        case when c.trigger_threshold is distinct from n.trigger_threshold then 'trigger_threshold' end,
        case when c.trigger_confidence is distinct from n.trigger_confidence then 'trigger_confidence' end
    ) as "column"
from examined_pair p join rollouts c using (run) join rollouts n on n.run = p.nominal_run
where "column" is not null
qualify row_number() over (partition by c.group_id order by c.rollout_id) = 1
