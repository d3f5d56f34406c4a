-- subjects: attempt where run in (select run from observation where tick - t_b between -80 and 50)
with near as (
    select o.id, o.x_m, o.y_m, g.*,
        least(greatest(((o.x_m - a_x) * e_x + (o.y_m - a_y) * e_y) / (e_x * e_x + e_y * e_y), 0), 1) as share
    from observation o join attempt_route using (run) join segment g using (route)
    where o.tick between o.t_b - 80 and o.t_b + 50
), foot as (
    select id, sqrt(pow(x_m - a_x - share * e_x, 2) + pow(y_m - a_y - share * e_y, 2)) as distance,
        s_a + share * length as progress, atan2(e_y, e_x) as heading,
        case when e_x * (y_m - a_y) - e_y * (x_m - a_x) < 0 then -1 else 1 end as side
    from near
), nearest as (
    select id, min(distance) as distance from foot group by id
), judged as (
    select id, bool_or(
        f.distance <= n.distance + $route_tolerance_m
        and abs(route_progress_m - progress) <= $route_tolerance_m + 1e-6 * progress
        and abs(route_offset_m - side * f.distance) <= $route_tolerance_m + 1e-6 * f.distance
        and abs(wrap(route_heading_error_rad - (yaw_rad::double - heading))) <= $route_tolerance_rad) as agrees
    from foot f join nearest n using (id) join observation o using (id)
    group by id
)
select rollout_id, group_id, 'observations' as "table", 'route_progress_m' as "column", min(tick) as tick
from judged join observation using (id) where not agrees
group by rollout_id, group_id
