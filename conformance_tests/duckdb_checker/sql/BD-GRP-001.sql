-- subjects: chosen_nominal
select candidate.group_id as group_id, candidate.rollout_id as rollout_id, 'rollouts' as "table", list_filter([
        case when candidate.route_id is distinct from nominal.route_id then 'route_id' end,
        case when candidate.route_x_m is distinct from nominal.route_x_m then 'route_x_m' end,
        case when candidate.route_y_m is distinct from nominal.route_y_m then 'route_y_m' end
    ], lambda name: name is not null)[1] as "column"
from chosen_pair where "column" is not null
qualify row_number() over (partition by candidate.group_id order by candidate.rollout_id) = 1
