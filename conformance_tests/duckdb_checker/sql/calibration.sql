-- Values of attempts with enough motion to tell sign, unit and clock (spec/07-rules.md#calibration).
create or replace temp table calibration as
with way as (
    select run, tick, x_m - x_0 as dx, y_m - y_0 as dy, sqrt(dx * dx + dy * dy) as s,
        wrap(yaw_rad::double - yaw_0) as q, v_0::double as v_0, speed_mps::double as v, yaw_0 + q / 2 as heading,
        abs(v_0 + v) * 0.125 as r, (w_0::double + yaw_rate_radps) / 2 as w, accel_longitudinal_mps2::double as a_long, accel_lateral_mps2::double as a_lat
    from step
), commanded as (  -- steps of 5 ticks that no policy is active at
    select w.run, w.tick, avg(applied_steer::double) as u, avg(applied_throttle::double - applied_brake) as b
    from way w join controls c on c.run = w.run and c.tick between w.tick - 5 and w.tick - 1
    group by all having count(*) = 5 and not bool_or(active)
), actor_way as (
    select n.run, n.actor_class, n.actor_class in ('vehicle', 'cycle') as is_driving,
        sqrt(pow(n.x_m - p.x_m, 2) + pow(n.y_m - p.y_m, 2)) as s,
        (n.vel_x_mps::double + p.vel_x_mps) / 2 as v_x, (n.vel_y_mps::double + p.vel_y_mps) / 2 as v_y,
        sqrt(v_x * v_x + v_y * v_y) as v, wrap(n.yaw_rad::double - p.yaw_rad) as q, n.yaw_rad - q / 2 as heading
    from track n join track p on p.run = n.run and p.actor_id = n.actor_id and p.tick = n.tick - 5
)
select run, 'speed' as quantity, 'observations' as "table", 'speed_mps' as "column",
    sum(r) / sum(s) as value, 0.99 as least, 1.01 as most
from way where s >= 0.5 group by run having count(*) >= 4
union all
select run, 'step', 'observations', 'x_m', sum(abs(r - s)) / sum(s), 0, 0.05
from way where s >= 0.5 group by run having count(*) >= 4
union all
select run, 'yaw rate', 'observations', 'yaw_rate_radps', sum(w * q / 0.25) / sum(pow(q / 0.25, 2)), 0.6, 1.6
from way where abs(q / 0.25) >= 0.05 group by run having count(*) >= 4
union all
select run, 'longitudinal', 'observations', 'accel_longitudinal_mps2',
    sum(a_long * (v - v_0) / 0.25) / sum(pow((v - v_0) / 0.25, 2)), 0.5, 2
from way where abs(v - v_0) / 0.25 >= 0.5 group by run having count(*) >= 4
union all
select run, 'lateral', 'observations', 'accel_lateral_mps2', sum(a_lat * v * q / 0.25) / sum(pow(v * q / 0.25, 2)), 0.5, 2
from way where abs(v * q / 0.25) >= 0.5 group by run having count(*) >= 4
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
select run, 'actor speed', 'actors', 'vel_x_mps', sum(v * 0.25) / sum(s), 0.95, 1.05
from actor_way where is_driving and s >= 0.5 group by run having count(*) >= 4
union all
select run, 'pedestrian speed', 'actors', 'vel_x_mps', sum(v * 0.25) / sum(s), 0.95, 1.05
from actor_way where actor_class = 'pedestrian' and s >= 0.25 group by run having count(*) >= 4;
