-- subjects: chosen_nominal
select candidate.group_id as group_id, candidate.rollout_id as rollout_id, 'rollouts' as "table", list_filter([
        case when candidate.branch_tick is distinct from nominal.branch_tick then 'branch_tick' end,
        case when candidate.branch_frame is distinct from nominal.branch_frame then 'branch_frame' end,
        case when candidate.trigger_definition is distinct from nominal.trigger_definition then 'trigger_definition' end,
        case when candidate.trigger_tick is distinct from nominal.trigger_tick then 'trigger_tick' end,
        case when candidate.trigger_signal is distinct from nominal.trigger_signal then 'trigger_signal' end,
        case when candidate.trigger_value is distinct from nominal.trigger_value then 'trigger_value' end,
        case when candidate.trigger_threshold is distinct from nominal.trigger_threshold then 'trigger_threshold' end,
        case when candidate.trigger_confidence is distinct from nominal.trigger_confidence then 'trigger_confidence' end
    ], lambda name: name is not null)[1] as "column"
from chosen_pair where "column" is not null
qualify row_number() over (partition by candidate.group_id order by candidate.rollout_id) = 1
