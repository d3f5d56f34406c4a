-- subjects: map
select shard, town, element_id, 'map' as "table", 'x_m' as "column"
from map
where len(x_m) <> len(y_m) or len(z_m) <> len(x_m) or len(width_m) <> len(x_m)
    or len(x_m) > $max_route_vertices
    or case when kind in ('signal', 'stop_sign', 'yield_sign') then len(x_m) <> 1
            when kind in ('road_area', 'crossing') then len(x_m) < 3
            else len(x_m) < 2 end
    or (kind = 'lane' and lane_id is null)
    or (kind in ('lane', 'shoulder', 'parking') and width_m is null)
    or list_bool_or([x_m[i] = x_m[i + 1] and y_m[i] = y_m[i + 1] for i in range(1, len(x_m))])
    or (kind in ('road_area', 'crossing') and x_m[1] = x_m[-1] and y_m[1] = y_m[-1])
