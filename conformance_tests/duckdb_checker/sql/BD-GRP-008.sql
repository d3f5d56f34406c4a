-- subjects: chosen_nominal
select candidate.group_id as group_id, candidate.rollout_id as rollout_id, 'rollouts' as "table", list_filter([
        case when candidate.simulator_version is distinct from nominal.simulator_version then 'simulator_version' end,
        case when candidate.collector_version is distinct from nominal.collector_version then 'collector_version' end
    ], lambda name: name is not null)[1] as "column"
from chosen_pair where "column" is not null
qualify row_number() over (partition by candidate.group_id order by candidate.rollout_id) = 1
