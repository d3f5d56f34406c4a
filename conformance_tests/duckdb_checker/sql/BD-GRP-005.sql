-- subjects: chosen_nominal
select candidate.group_id as group_id, candidate.rollout_id as rollout_id, 'rollouts' as "table", list_filter([
        case when candidate.scenario_type is distinct from nominal.scenario_type then 'scenario_type' end,
        case when candidate.environment is distinct from nominal.environment then 'environment' end,
        case when candidate.ego_length_m is distinct from nominal.ego_length_m then 'ego_length_m' end,
        case when candidate.ego_width_m is distinct from nominal.ego_width_m then 'ego_width_m' end,
        case when candidate.ego_height_m is distinct from nominal.ego_height_m then 'ego_height_m' end
    ], lambda name: name is not null)[1] as "column"
from chosen_pair where "column" is not null
qualify row_number() over (partition by candidate.group_id order by candidate.rollout_id) = 1
