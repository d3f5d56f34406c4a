-- subjects: (select a.* from attempt a join (select run from observation where tick - t_b between -80 and 50 group by run having count(*) > 1) using (run))
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
), foot as (
    select *, s_a + share * length as s from near
    where sqrt(pow(px - a_x - share * e_x, 2) + pow(py - a_y - share * e_y, 2)) <= slack
), placed_once as (
    select id, number, any_value(slack) as slack, max(s) as most,
        min(s) filter (s >= progress - $route_tolerance_m - 1e-6 * progress) as ahead
    from foot group by id, number
), point as (
    -- the second is in order of the first, or at the end
    select o.run, t.nominal_run, o.rollout_id, o.group_id, o.tick, o.x_m, o.y_m, o.route_progress_m::double as progress, route, p.number,
        p.most, $route_tolerance_m + p.slack + 1e-6 * o.route_progress_m as room,
        case when p.number = 1 then p.ahead else (
            select min(f.s) from foot f join attempt_route r using (run)
            where f.id = p.id and f.number = 2 and f.s >= least(
                one.ahead + $route_tolerance_m + 1e-6 * one.ahead, r.total - $route_tolerance_m - 1e-6 * r.total)) end as least
    from placed_once p join observation o using (id) join attempt_route using (run) join attempt t using (run)
    join placed_once one on one.id = p.id and one.number = 1
)
select b.rollout_id, b.group_id, 'observations' as "table", 'target_point_1_x_m' as "column", min(b.tick) as tick
from point b join point a on a.number = b.number and a.route = b.route
    and ((a.run = b.run and a.tick < b.tick) or (a.run = b.nominal_run and a.run <> b.run))
where ((b.progress >= a.progress + a.room + b.room or (a.x_m = b.x_m and a.y_m = b.y_m and a.progress = b.progress)) and b.most < a.least - a.room - b.room)
    or ((a.progress >= b.progress + a.room + b.room or (a.x_m = b.x_m and a.y_m = b.y_m and a.progress = b.progress)) and a.most < b.least - a.room - b.room)
group by b.rollout_id, b.group_id
