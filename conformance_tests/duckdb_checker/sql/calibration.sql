-- Values of attempts with enough motion to tell sign, unit and clock (spec/07-rules.md#calibration).
create or replace temp table calibration as
with way as (
    select run, x_m - x_0 as dx, y_m - y_0 as dy, sqrt(dx * dx + dy * dy) as s,
        wrap(yaw_rad::double - yaw_0) as q, v_0::double as v_0, speed_mps::double as v, yaw_0 + q / 2 as heading,
        (w_0::double + yaw_rate_radps) / 2 as w, accel_longitudinal_mps2::double as a_long, accel_lateral_mps2::double as a_lat
    from step
)
select run, 'observations' as "table", 'speed_mps' as "column",
    sum(abs(v_0 + v) * 0.125) / sum(s) as value, 0.95 as least, 1.05 as most
from way where s >= 0.5 group by run having count(*) >= 4
union all
select run, 'observations', 'yaw_rate_radps', sum(w * q / 0.25) / sum(pow(q / 0.25, 2)), 0.5, 2
from way where abs(q / 0.25) >= 0.05 group by run having count(*) >= 4
union all
select run, 'observations', 'accel_longitudinal_mps2',
    sum(a_long * (v - v_0) / 0.25) / sum(pow((v - v_0) / 0.25, 2)), 0.5, 2
from way where abs(v - v_0) / 0.25 >= 0.5 group by run having count(*) >= 4
union all
select run, 'observations', 'accel_lateral_mps2', sum(a_lat * v * q / 0.25) / sum(pow(v * q / 0.25, 2)), 0.5, 2
from way where abs(v * q / 0.25) >= 0.5 group by run having count(*) >= 4
union all
select run, 'observations', 'yaw_rad', degrees(atan2(
    sum(sign(v_0 + v) * (cos(heading) * dy - sin(heading) * dx)),
    sum(sign(v_0 + v) * (cos(heading) * dx + sin(heading) * dy)))), -3, 3
from way where s >= 0.5 and abs(q) <= 0.01 group by run having count(*) >= 4
union all
select run, 'actors', 'yaw_rad',
    sum(vel_x_mps * cos(yaw_rad::double) + vel_y_mps * sin(yaw_rad::double)) / sum(sqrt(pow(vel_x_mps::double, 2) + pow(vel_y_mps::double, 2))),
    0.9, 1 + 1e-9
from track join contact using (run)
where tick < first_tick and actor_class in ('vehicle', 'cycle') and abs(vel_y_mps::double) >= 0.5 * sqrt(pow(vel_x_mps::double, 2) + pow(vel_y_mps::double, 2))
    and sqrt(pow(vel_x_mps::double, 2) + pow(vel_y_mps::double, 2)) >= 2
group by run having count(*) >= 4;
