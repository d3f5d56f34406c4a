-- subjects: attempt where t_b is not null
with near as (
    select o.shard, o.rollout_id, o.group_id, o.tick, o.route_progress_m, o.route_offset_m, o.route_heading_error_rad,
        o.yaw_rad, o.x_m, o.y_m, g.*,
        least(greatest(((o.x_m - a_x) * e_x + (o.y_m - a_y) * e_y) / (e_x * e_x + e_y * e_y), 0), 1) as share
    from observation o join attempt_route using (shard, rollout_id) join segment g using (route)
    where o.tick between o.t_b - 80 and o.t_b + 50
), foot as (
    select *, sqrt(pow(x_m - a_x - share * e_x, 2) + pow(y_m - a_y - share * e_y, 2)) as distance,
        s_a + share * length as progress,
        min(sqrt(pow(x_m - a_x - share * e_x, 2) + pow(y_m - a_y - share * e_y, 2)))
            over (partition by shard, rollout_id, tick) as nearest
    from near
), judged as (
    select rollout_id, group_id, tick, bool_or(
        distance <= nearest + $route_tolerance_m
        and abs(route_progress_m - progress) <= $route_tolerance_m + 1e-6 * progress
        and abs(route_offset_m - case when e_x * (y_m - a_y) - e_y * (x_m - a_x) < 0 then -distance else distance end)
            <= $route_tolerance_m + 1e-6 * distance
        and abs(wrap(route_heading_error_rad - (yaw_rad::double - atan2(e_y, e_x)))) <= $route_tolerance_rad) as agrees
    from foot group by rollout_id, group_id, tick
)
select rollout_id, group_id, 'observations' as "table", 'route_progress_m' as "column", min(tick) as tick
from judged where not agrees
group by rollout_id, group_id
