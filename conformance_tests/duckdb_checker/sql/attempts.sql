-- Attempts that qualification rules examine, with the policy of their key, and their rows.
create or replace temp table attempt as
select r.*, r.branch_tick as t_b, p.* exclude (key)
from rollouts r join policy p on p.key = r.action_key
where r.status = 'complete' and r.rollout_id not in (select rollout_id from faulty);

create or replace temp table control as
select c.*, a.group_id, a.role, a.t_b, a.nominal_run
from controls c join attempt a using (run);

create or replace temp table command as
select run, c.rollout_id, c.group_id, c.role, tick, active, 'steer' as actuator, steer_rule as rule,
    steer_value as value, expert_steer as expert, nominal_steer as nominal, intended_steer as intended,
    applied_steer as applied
from control c join attempt using (run)
union all
select run, c.rollout_id, c.group_id, c.role, tick, active, 'throttle', throttle_rule,
    throttle_value, expert_throttle, nominal_throttle, intended_throttle, applied_throttle
from control c join attempt using (run)
union all
select run, c.rollout_id, c.group_id, c.role, tick, active, 'brake', brake_rule,
    brake_value, expert_brake, nominal_brake, intended_brake, applied_brake
from control c join attempt using (run);

create or replace temp table observation as
select row_number() over () as id, o.*, a.group_id, a.t_b from observations o join attempt a using (run);

-- Observations that no contact keeps from being judged, and how many of an attempt may break a relation all the same.
create or replace temp table free as
select o.run, o.tick, coalesce(o.tick - c.tick > 5 * $rest_observations, true) as is_free
from observation o
asof left join (select run, tick from evidence where collision) c on c.run = o.run and o.tick >= c.tick;

create or replace temp table forgiven as
select run, case when $has_evidence or coalesce(result_num_vehicle_collisions + result_num_pedestrian_collisions
    + result_num_static_collisions = 0, false) then 0 else $rest_observations end as most
from attempt;

-- Neighbouring observations.
create or replace temp table step as
select n.*, p.x_m as x_0, p.y_m as y_0, p.yaw_rad as yaw_0, p.speed_mps as v_0, p.yaw_rate_radps as w_0
from observation n
join observation p on p.run = n.run and p.tick = n.tick - 5;

-- Polylines, each once, and their segments with the arc length before them.
create or replace temp table route as
select row_number() over () as route, route_x_m, route_y_m
from (select distinct route_x_m, route_y_m from attempt);

create or replace temp table segment as
select *, b_x - a_x as e_x, b_y - a_y as e_y, sqrt(pow(b_x - a_x, 2) + pow(b_y - a_y, 2)) as length,
    coalesce(sum(sqrt(pow(b_x - a_x, 2) + pow(b_y - a_y, 2)))
        over (partition by route order by i rows between unbounded preceding and 1 preceding), 0) as s_a
from (
    select route, i, route_x_m[i] as a_x, route_y_m[i] as a_y, route_x_m[i + 1] as b_x, route_y_m[i + 1] as b_y
    from route, unnest(range(1, len(route_x_m))) as places(i)
);

create or replace temp table attempt_route as
select run, route, total
from attempt a join route using (route_x_m, route_y_m)
join (select route, sum(length) as total from segment group by route) using (route);

-- Rows of actors at the observations from t_b - 75 to t_b + 50, and when their tracks begin.
create or replace temp table track as
select c.*, a.group_id, a.t_b, min(c.tick) over (partition by c.run, c.actor_id) as begin_tick
from actors c join attempt a using (run)
where c.tick between a.t_b - 75 and a.t_b + 50;

-- Vehicles where their tracks begin, of all attempts.
create or replace temp table body_of_vehicle as
select width_m from (
    select c.width_m, c.actor_class, o.before, lag(c.tick) over (partition by c.run, c.actor_id order by c.tick) as last
    from actors c join rollouts r using (run)
    left join (select run, tick, lag(tick) over (partition by run order by tick) as before from observations) o
        on o.run = c.run and o.tick = c.tick
    where c.tick between r.branch_tick - 75 and r.branch_tick + 50)
where actor_class = 'vehicle' and (last is null or last is distinct from before);

-- Observations of the window at which an ego that is slow brakes for pedestrians, and whether one has a row.
create or replace temp table braking as
select run, tick, rollout_id, group_id,
    exists (from actors c where c.run = o.run and c.tick = o.tick and c.actor_class = 'pedestrian') as is_there
from observation o
where pedestrian_hazard and tick between t_b - 75 and t_b + 50 and abs(speed_mps) <= $heeding_mps and $has_evidence;
