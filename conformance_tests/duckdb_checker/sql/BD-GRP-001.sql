-- subjects: compared_nominal
select c.group_id as group_id, c.rollout_id as rollout_id, 'rollouts' as "table", coalesce(
        case when c.route_id is distinct from n.route_id then 'route_id' end,
        case when c.route_x_m is distinct from n.route_x_m then 'route_x_m' end,
        case when c.route_y_m is distinct from n.route_y_m then 'route_y_m' end
    ) as "column"
from examined_pair p join rollouts c using (run) join rollouts n on n.run = p.nominal_run
where "column" is not null
qualify row_number() over (partition by c.group_id order by c.rollout_id) = 1
