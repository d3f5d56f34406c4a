-- Values of attempts with enough motion to tell sign, unit and clock (spec/07-rules.md#calibration).
create or replace temp table calibration as
with way as (
    select run, tick, x_m - x_0 as dx, y_m - y_0 as dy, sqrt(dx * dx + dy * dy) as s,
        wrap(yaw_rad::double - yaw_0) as q, v_0::double as v_0, speed_mps::double as v, yaw_0 + q / 2 as heading,
        yaw_rate_radps::double as rate,
        abs(v_0 + v) * 0.125 as r, (w_0::double + yaw_rate_radps) / 2 as w, accel_longitudinal_mps2::double as a_long, accel_lateral_mps2::double as a_lat
    from step
), commanded as (  -- steps of 5 ticks that no policy is active at
    select w.run, w.tick, avg(applied_steer::double) as u, avg(applied_throttle::double - applied_brake) as b
    from way w join controls c on c.run = w.run and c.tick between w.tick - 5 and w.tick - 1
    group by all having count(*) = 5 and not bool_or(active)
), actor_way as (
    select n.run, n.actor_id, n.tick, n.actor_class, n.actor_class in ('vehicle', 'cycle') as is_driving,
        n.x_m - p.x_m as dx, n.y_m - p.y_m as dy, n.vel_x_mps::double as vel_x, n.vel_y_mps::double as vel_y,
        sqrt(pow(n.x_m - p.x_m, 2) + pow(n.y_m - p.y_m, 2)) as s,
        (n.vel_x_mps::double + p.vel_x_mps) / 2 as v_x, (n.vel_y_mps::double + p.vel_y_mps) / 2 as v_y,
        sqrt(v_x * v_x + v_y * v_y) as v, wrap(n.yaw_rad::double - p.yaw_rad) as q, n.yaw_rad - q / 2 as heading
    from track n join track p on p.run = n.run and p.actor_id = n.actor_id and p.tick = n.tick - 5
), ratio as (  -- of recorded values to those of the positions
    select run, 'speed' as quantity, 'observations' as "table", 'speed_mps' as "column",
        sum(r) / sum(s) as value, 0.99 as least, 1.01 as most
    from way where s >= 0.5 group by run having count(*) >= 4
    union all
    select run, 'actor speed', 'actors', 'vel_x_mps', sum(v * 0.25) / sum(s), 0.95, 1.05
    from actor_way where is_driving and s >= 0.5 group by run having count(*) >= 4
    union all
    select run, 'longitudinal', 'observations', 'accel_longitudinal_mps2',
        sum(a_long * (v - v_0) / 0.25) / sum(pow((v - v_0) / 0.25, 2)), 0.5, 2
    from way where abs(v - v_0) / 0.25 >= 0.5 group by run having count(*) >= 4
    union all
    select run, 'lateral', 'observations', 'accel_lateral_mps2', sum(a_lat * v * q / 0.25) / sum(pow(v * q / 0.25, 2)), 0.5, 2
    from way where abs(v * q / 0.25) >= 0.5 group by run having count(*) >= 4
    union all
    select run, 'yaw rate', 'observations', 'yaw_rate_radps', sum(w * q / 0.25) / sum(pow(q / 0.25, 2)), 0.6, 1.6
    from way where abs(q / 0.25) >= 0.05 group by run having count(*) >= 4
), two as (  -- steps from observation 0 to 1 and from 1 to 2
    select b.run, b.v, b.a_long, b.a_lat, a.v as v_1, a.rate as rate_1, b.v * b.rate as push, a.v * a.rate as push_1,
        a.s / 0.25 as way_1, b.s / 0.25 as way, a.q / 0.25 as turn_1, b.q / 0.25 as turn,
        (a.v - a.v_0) / 0.25 as gain_1, (b.v - b.v_0) / 0.25 as gain
    from way a join way b on b.run = a.run and b.tick = a.tick + 5
), pair as (  -- what recorded rates r are held against, along both axes
    select run, 'speed' as of_ratio, 'observations' as "table", 'speed_mps' as "column", 0.125 as change,
        abs(v_1) as r_x, 0.0 as r_y, way_1 as x_0, way as x_1, 0.0 as y_0, 0.0 as y_1 from two
    union all
    select run, null, 'observations', 'yaw_rate_radps', 0.05, rate_1, 0, turn_1, turn, 0, 0 from two
    union all
    select run, 'longitudinal', 'observations', 'accel_longitudinal_mps2', 0.5, a_long, 0, gain_1, gain, 0, 0 from two
    union all
    select run, 'lateral', 'observations', 'accel_lateral_mps2', 0.5, a_lat, 0, push_1, push, 0, 0 from two
    where abs(v) between 8 and 15
    union all
    select b.run, 'actor speed', 'actors', 'vel_x_mps', 0.125,
        a.vel_x, a.vel_y, a.dx / 0.25, b.dx / 0.25, a.dy / 0.25, b.dy / 0.25
    from actor_way a join actor_way b on b.run = a.run and b.actor_id = a.actor_id and b.tick = a.tick + 5
    where b.is_driving and a.s >= 0.5 and b.s >= 0.5
), lead as (
    select run, "table", "column", any_value(of_ratio) as of_ratio,
        sum(r_x * (x_1 - x_0) + r_y * (y_1 - y_0)) as by_change,
        sum((x_1 * x_1 - x_0 * x_0 + y_1 * y_1 - y_0 * y_0) / 2) as mixed,
        sum(pow(x_1 - x_0, 2) + pow(y_1 - y_0, 2)) as changes
    from pair where sqrt(pow(x_1 - x_0, 2) + pow(y_1 - y_0, 2)) >= change
    group by run, "table", "column" having count(*) >= 4
)
select * from ratio
union all
select l.run, 'lead of ' || l."column", l."table", l."column",
    (by_change / if(of_ratio is null, 1, ratio.value) - mixed) / changes,
    if(l."column" like 'accel%', 0.25, -0.55), if(l."column" like 'accel%', 'inf'::double, 0.55)
from lead l left join ratio on ratio.run = l.run and ratio.quantity = of_ratio
left join ratio y on y.run = l.run and y.quantity = 'yaw rate'
where (of_ratio is null or ratio.value <> 0)
    and (l."column" <> 'yaw_rate_radps' or y.value between 0.25 and 4)
    and (l."column" <> 'accel_lateral_mps2' or y.value is null or y.value between 0.25 and 4)
union all
select run, 'step', 'observations', 'x_m', sum(abs(r - s)) / sum(s), 0, 0.05
from way where s >= 0.5 group by run having count(*) >= 4
union all
select run, 'heading', 'observations', 'yaw_rad', degrees(atan2(
    sum(sign(v_0 + v) * (cos(heading) * dy - sin(heading) * dx)),
    sum(sign(v_0 + v) * (cos(heading) * dx + sin(heading) * dy)))), -3, 3
from way where s >= 0.5 and abs(q) <= 0.01 group by run having count(*) >= 4
union all
select run, 'steering', 'controls', 'applied_steer', sum(q / 0.25 * -u * (v_0 + v) / 2) / sum(pow(u * (v_0 + v) / 2, 2)), 0, 'inf'::double
from way join commanded using (run, tick)
where s >= 0.5 and abs(q / 0.25) >= 0.05 group by run having count(*) >= 4 and sum(pow(u * (v_0 + v) / 2, 2)) > 0
union all
select run, 'drive', 'controls', 'applied_throttle', sum(sign(v_0 + v) * (v - v_0) / 0.25 * b) / sum(pow(b, 2)), 0, 'inf'::double
from way join commanded using (run, tick)
where s >= 0.5 and abs(v - v_0) / 0.25 >= 0.5 group by run having count(*) >= 4 and sum(pow(b, 2)) > 0
union all
select run, 'pivot', 'observations', 'x_m',
    sum((cos(heading) * dy - sin(heading) * dx) * q) / sum(q * q * $wheelbase_m), 0.15, 0.85
from way where $wheelbase_m is not null and abs(q / 0.25) >= 0.05 and abs(v_0 + v) / 2 <= 8
group by run having count(*) >= 4
union all
select run, 'actor sense', 'actors', 'yaw_rad', sum(cos(heading) * v_x + sin(heading) * v_y) / sum(v), 0.9, 1 + 1e-9
from actor_way where is_driving and s >= 0.5 and abs(v_y) >= 0.5 * v group by run having count(*) >= 4
union all
select run, 'actor heading', 'actors', 'yaw_rad', degrees(atan2(
    sum(abs(cos(heading) * v_y - sin(heading) * v_x)), sum(cos(heading) * v_x + sin(heading) * v_y))), 0, 3
from actor_way where is_driving and s >= 0.5 and abs(q) <= 0.01 group by run having count(*) >= 4
union all
select run, 'pedestrian speed', 'actors', 'vel_x_mps', sum(v * 0.25) / sum(s), 0.95, 1.05
from actor_way where actor_class = 'pedestrian' and s >= 0.25 group by run having count(*) >= 4;
