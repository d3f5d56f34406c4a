-- Feet of target points on their polylines, at the observations from t_b - 80 to t_b + 50, within the tolerance.
create or replace temp table target_foot as
with target as (
    select id, run, 1 as number, x_m, y_m, yaw_rad::double as yaw, route_progress_m as progress,
        target_point_1_x_m::double as tx, target_point_1_y_m::double as ty
    from observation where tick between t_b - 80 and t_b + 50
    union all
    select id, run, 2, x_m, y_m, yaw_rad::double, route_progress_m,
        target_point_2_x_m::double, target_point_2_y_m::double
    from observation where tick between t_b - 80 and t_b + 50
), placed as (
    select *, x_m + tx * cos(yaw) - ty * sin(yaw) as px, y_m + tx * sin(yaw) + ty * cos(yaw) as py,
        $route_tolerance_m + 1e-6 * sqrt(tx * tx + ty * ty) as slack
    from target
), near as (
    select p.*, g.*, least(greatest(((px - a_x) * e_x + (py - a_y) * e_y) / (e_x * e_x + e_y * e_y), 0), 1) as share
    from placed p join attempt_route using (run) join segment g using (route)
)
select *, s_a + share * length as s from near
where sqrt(pow(px - a_x - share * e_x, 2) + pow(py - a_y - share * e_y, 2)) <= slack;
