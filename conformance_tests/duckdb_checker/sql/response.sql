-- Chosen interventions compared with their chosen nominal from t_b - 80 to t_b + 50 (spec/07-rules.md#response).
create or replace temp table compared as
select candidate.shard as shard, candidate.group_id as group_id, candidate.action_key as action_key,
    candidate.rollout_id as rollout_id, nominal.rollout_id as nominal_id, nominal.shard as nominal_shard,
    candidate.branch_tick as t_b, nominal.branch_tick as nominal_t_b
from chosen_pair where candidate.branch_tick is not null and nominal.branch_tick is not null;

create or replace temp table effect as
with driven as (
    select p.rollout_id, count(*) as controls, avg(c.applied_steer::double - n.applied_steer) as steer,
        avg(c.applied_throttle::double - c.applied_brake - (n.applied_throttle::double - n.applied_brake)) as drive
    from compared p join controls c using (shard, rollout_id)
    join controls n on n.shard = p.nominal_shard and n.rollout_id = p.nominal_id
        and n.tick - p.nominal_t_b = c.tick - p.t_b
    where c.tick between p.t_b and p.t_b + 49
    group by p.rollout_id
), seen as (
    select p.rollout_id, count(*) as observations, min(o.tick - p.t_b) filter (
            o.x_m <> n.x_m or o.y_m <> n.y_m or o.yaw_rad <> n.yaw_rad or o.speed_mps <> n.speed_mps) as first_difference,
        max(-sin(n.yaw_rad::double) * (o.x_m - n.x_m) + cos(n.yaw_rad::double) * (o.y_m - n.y_m))
            filter (o.tick = p.t_b + 50) as left_m,
        max(o.speed_mps::double - n.speed_mps) filter (o.tick = p.t_b + 50) as faster,
        min(n.speed_mps) filter (o.tick >= p.t_b) > 0.5 as moves
    from compared p join observations o using (shard, rollout_id)
    join observations n on n.shard = p.nominal_shard and n.rollout_id = p.nominal_id
        and n.tick - p.nominal_t_b = o.tick - p.t_b
    where o.tick between p.t_b - 80 and p.t_b + 50
    group by p.rollout_id
)
select p.*, steer, drive, left_m, faster, moves, first_difference,
    abs(steer) >= 0.04 as steers, abs(drive) >= 0.04 as drives,
    case when first_difference >= 0 then first_difference end as response
from compared p join driven using (rollout_id) join seen using (rollout_id)
where controls = 50 and observations = 27;
