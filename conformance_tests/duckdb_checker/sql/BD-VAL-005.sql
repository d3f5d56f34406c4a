-- subjects: rollouts
select shard, rollout_id, 'rollouts' as "table", 'route_x_m' as "column"
from rollouts
where len(route_x_m) <> len(route_y_m) or len(route_x_m) < 2
    or list_bool_or([route_x_m[i] = route_x_m[i + 1] and route_y_m[i] = route_y_m[i + 1]
                     for i in range(1, len(route_x_m))])
