-- Chosen interventions compared with their chosen nominal from t_b - 80 to t_b + 50 (spec/07-rules.md#response).
create or replace temp table effect as
with compared as (
    select run, p.nominal_run, c.group_id, c.action_key, c.branch_tick as t_b
    from chosen_pair p join rollouts c using (run) join rollouts n on n.run = p.nominal_run
    where c.branch_tick = n.branch_tick
), driven as (
    select run, count(*) as controls, avg(c.applied_steer::double - n.applied_steer) as steer,
        avg(c.applied_throttle::double - c.applied_brake - (n.applied_throttle::double - n.applied_brake)) as drive,
        bool_and(c.expert_steer = n.applied_steer) as nominal_steer, bool_and(c.expert_steer = c.applied_steer) as own_steer,
        bool_and(c.expert_throttle = n.applied_throttle and c.expert_brake = n.applied_brake) as nominal_pedals,
        bool_and(c.expert_throttle = c.applied_throttle and c.expert_brake = c.applied_brake) as own_pedals,
        count(distinct c.expert_steer) = 1 as one_steer, count(distinct (c.expert_throttle, c.expert_brake)) = 1 as one_pedal
    from compared p join controls c using (run)
    join controls n on n.run = p.nominal_run and n.tick = c.tick
    where c.tick between t_b and t_b + 49
    group by run
), asked as (
    select run, count(distinct expert_steer) > 1 as changes_steer, count(distinct (expert_throttle, expert_brake)) > 1 as changes_pedals
    from compared p join controls c using (run) where c.tick between t_b - 1 and t_b + 50 group by run
), seen as (
    select run, count(*) as observations, min(o.tick - t_b) filter (
            o.x_m <> n.x_m or o.y_m <> n.y_m or o.yaw_rad <> n.yaw_rad or o.speed_mps <> n.speed_mps) as state_differs,
        -- rates tell of the control of t_b only where they are equal before
        min(o.tick - t_b) filter (o.tick <= t_b and (
            o.accel_longitudinal_mps2 <> n.accel_longitudinal_mps2 or o.accel_lateral_mps2 <> n.accel_lateral_mps2
            or o.yaw_rate_radps <> n.yaw_rate_radps)) as rate_differs,
        max(o.accel_longitudinal_mps2::double - n.accel_longitudinal_mps2) filter (o.tick = t_b) as sooner,
        max(o.accel_longitudinal_mps2::double - n.accel_longitudinal_mps2) filter (o.tick = t_b + 5) as later,
        md5((list(row(o.x_m, o.y_m, o.yaw_rad, o.speed_mps) order by o.tick) filter (o.tick > t_b))::varchar) as future,
        md5((list(row(n.x_m, n.y_m, n.yaw_rad, n.speed_mps) order by o.tick) filter (o.tick > t_b))::varchar) as nominal_future,
        max(-sin(n.yaw_rad::double) * (o.x_m - n.x_m) + cos(n.yaw_rad::double) * (o.y_m - n.y_m))
            filter (o.tick = t_b + 50) as left_m,
        max(o.speed_mps::double - n.speed_mps) filter (o.tick = t_b + 50) as faster,
        wrap(max(o.yaw_rad::double - n.yaw_rad) filter (o.tick = t_b + 20)
            - max(o.yaw_rad::double - n.yaw_rad) filter (o.tick = t_b)) as turn,
        min(abs(n.speed_mps)) filter (o.tick >= t_b) > 0.5 as moves,
        max(o.speed_mps::double) filter (o.tick = t_b) as began, max(o.speed_mps::double) filter (o.tick = t_b + 50) as ended
    from compared p join observations o using (run)
    join observations n on n.run = p.nominal_run and n.tick = o.tick
    where o.tick between t_b - 80 and t_b + 50
    group by run
)
select run, nominal_run, t_b, group_id, action_key, steer, drive, left_m, turn, faster, moves, began, ended, future, sooner, later,
    case when state_differs < 0 or rate_differs is distinct from 0 then state_differs else 0 end as first_difference,
    abs(steer) >= 0.04 as steers, abs(drive) >= 0.04 as drives, moves and (steers or drives) as is_commanded,
    case when first_difference >= 0 then first_difference end as response, nominal_future,
    moves and steers and abs(left_m) >= 0.1 and changes_steer and not $is_log as is_steered, one_steer, nominal_steer, own_steer,
    moves and drives and abs(faster) >= 0.1 and changes_pedals and not $is_log as is_driven, one_pedal, nominal_pedals, own_pedals
from compared join driven using (run) join asked using (run) join seen using (run)
where controls = 50 and observations = 27;

-- Groups that are compared with each other: by the drives of their attempts, and by outlines with actors.
create or replace temp table driven_group as
select distinct group_id from (
    select r.group_id from rollouts r join observations o using (run) group by r.run, r.group_id having count(*) > 16);

create or replace temp table outlined as
select distinct e.group_id from effect e join actors a on a.run = e.nominal_run and a.tick = e.t_b;

-- Two actions of a group whose nominal moves: differences of commands and of the first turn and acceleration.
create or replace temp table ordered as
select a.action_key, b.action_key as other, a.steer - b.steer as steer, a.drive - b.drive as drive,
    wrap(a.turn - b.turn) as turn, a.later - b.later as accel,
    abs(a.steer - b.steer) >= 0.04 as steers, abs(a.drive - b.drive) >= 0.04 as drives
from effect a join effect b on b.group_id = a.group_id and b.action_key < a.action_key where a.moves;

-- Two actions of a group that drive otherwise: whether they have one future, or are told apart.
create or replace temp table driving_pair as
select a.action_key, b.action_key as other, a.group_id, abs(a.drive - b.drive) as apart, a.began, a.ended,
    b.first_difference is not null and a.future = b.future and a.ended - a.began >= 2 as is_one,
    sign(a.drive - b.drive) * (a.later - b.later) >= 0.5 as is_told
from effect a join policy p on p.key = a.action_key
join effect b on b.group_id = a.group_id join policy q on q.key = b.action_key and q.rowid < p.rowid
where abs(a.drive - b.drive) >= 0.04 and abs(a.steer - b.steer) < 0.04;
