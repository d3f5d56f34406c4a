-- What the relations of motion say of every observation, whatever contacts there are.
create or replace temp table relation as
with way as (
    select *, (abs(v_0::double) + abs(speed_mps::double)) * 0.25 / 2 as s,
        x_m - x_0 - (v_0 * cos(yaw_0::double) + speed_mps * cos(yaw_rad::double)) * 0.25 / 2 as off_x,
        y_m - y_0 - (v_0 * sin(yaw_0::double) + speed_mps * sin(yaw_rad::double)) * 0.25 / 2 as off_y
    from step
)
select 'BD-MOT-001' as rule, run, tick, 'x_m' as "column",
    sqrt(off_x * off_x + off_y * off_y) > $displacement_m + $displacement_share * s as is_broken
from way
union all
select 'BD-MOT-002', run, tick, 'yaw_rad',
    abs(wrap(yaw_rad::double - yaw_0 - (w_0::double + yaw_rate_radps) * 0.25 / 2)) > $turn_rad
from step
union all
select 'BD-MOT-003', run, tick, 'accel_longitudinal_mps2',
    abs(accel_longitudinal_mps2::double - (speed_mps::double - v_0) / 0.25) > $acceleration_mps2
from step
union all
select 'BD-MOT-003', run, tick, 'accel_lateral_mps2',
    abs(accel_lateral_mps2::double - speed_mps::double * yaw_rate_radps) > $acceleration_mps2
from observation where tick > 0;

-- Those that are judged, and those that are wrong in more observations of their attempt than are forgiven.
create or replace temp table compared as
select r.*, most from relation r join free using (run, tick) join forgiven using (run) where is_free;

create or replace temp table broken as
select * from compared where is_broken qualify count(*) over (partition by "column", run) > most;

-- The same of actors.
create or replace temp table moved as
with moving as (
    select n.*, n.x_m - p.x_m - (p.vel_x_mps::double + n.vel_x_mps) * 0.25 / 2 as off_x,
        n.y_m - p.y_m - (p.vel_y_mps::double + n.vel_y_mps) * 0.25 / 2 as off_y,
        sqrt(pow(p.vel_x_mps::double + n.vel_x_mps, 2) + pow(p.vel_y_mps::double + n.vel_y_mps, 2)) * 0.25 / 2 as way
    from track n join track p on p.run = n.run and p.actor_id = n.actor_id and p.tick = n.tick - 5
)
select 'BD-ACT-004' as rule, m.run, m.rollout_id, m.group_id, tick, m.actor_id, is_free,
    sqrt(off_x * off_x + off_y * off_y) > $displacement_m + $displacement_share * way as is_broken
from moving m join free using (run, tick);

-- Accelerations and yaw rates at tick 0, which has no past.
create or replace temp table standing as
select run, tick, "column", place from (
    select run, tick, unnest([1, 2, 3]) as place,
        unnest(['accel_longitudinal_mps2', 'accel_lateral_mps2', 'yaw_rate_radps']) as "column",
        unnest([accel_longitudinal_mps2, accel_lateral_mps2, yaw_rate_radps]) as value
    from observation where tick = 0
) where value <> 0;

-- Actors that come back after a gap of their track over which there is no contact.
create or replace temp table returned as
with seen as (
    select *, lag(tick) over before as tick_0, lag(x_m) over before as x_0, lag(y_m) over before as y_0,
        lag(vel_x_mps) over before as v_x_0, lag(vel_y_mps) over before as v_y_0
    from track window before as (partition by run, actor_id order by tick)
)
select s.*, (s.tick - tick_0) * 0.05 as gone, (v_x_0::double + vel_x_mps) * gone / 2 as way_x,
    (v_y_0::double + vel_y_mps) * gone / 2 as way_y
from seen s join free f on f.run = s.run and f.tick = s.tick_0 and f.is_free
where exists (from observation o where o.run = s.run and o.tick > s.tick_0 and o.tick < s.tick)
    and not exists (from evidence e where e.run = s.run and e.collision and e.tick > s.tick_0 and e.tick <= s.tick);
