-- subjects: attempt where run in (select run from observations where command in ('left', 'right') and run in (select run from attempt_route))
with stepped as (
    select o.run, o.tick, o.command, route, o.route_progress_m::double as s,
        lag(o.tick) over way as tick_0, lag(o.command) over way as command_0, lag(o.route_progress_m::double) over way as s_0,
        sqrt(pow(o.x_m - lag(o.x_m) over way, 2) + pow(o.y_m - lag(o.y_m) over way, 2)) as way_m
    from observation o join attempt_route using (run)
    window way as (partition by o.run order by o.tick)
), numbered as (
    select *, sum((not coalesce(tick_0 = tick - 5 and command_0 = command and abs(s - s_0) <= $displacement_m + 2 * way_m, false))::integer)
        over (partition by run order by tick) as number
    from stepped
), commanded as (
    select run, number, route, min(tick) as tick, min(s) as least, max(s) as most, if(any_value(command) = 'left', 1, -1) as side
    from numbered where command in ('left', 'right') group by run, number, route
), bend as (
    select route, s_a, wrap(atan2(e_y, e_x) - atan2(lag(e_y) over along, lag(e_x) over along)) as turn
    from segment window along as (partition by route order by i)
), turned as (
    select run, number, tick, sum(-side * turn) filter (s_a > least and s_a < most) as away,
        coalesce(sum(greatest(side * turn, 0)) filter (s_a > least - 50 and s_a < most + 50), 0) as named
    from commanded join bend using (route) group by run, number, tick
)
select rollout_id, group_id, 'observations' as "table", 'command' as "column", min(t.tick) as tick
from turned t join attempt using (run)
where away >= pi() / 4 and named < pi() / 12
group by rollout_id, group_id
