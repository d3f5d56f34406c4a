-- Values in which nominal replays are compared with their nominal, one row for each value that both have.
create or replace temp table replay as
select a.shard, a.rollout_id, a.group_id, a.nominal_rollout_id from attempt a where role = 'nominal_replay'
    and rollout_id not in (select rollout_id from failed where rule = 'BD-GRP-006' or rule = 'BD-TIC-003');

create or replace temp table replayed as
select *, r_value is distinct from n_value or signbit(r_value) is distinct from signbit(n_value) as differs
from (
    select r.shard, r.rollout_id, r.group_id, o.tick, 'observations' as "table",
        unnest(['x_m', 'y_m', 'yaw_rad', 'speed_mps']) as "column",
        unnest([o.x_m, o.y_m, o.yaw_rad, o.speed_mps]) as r_value, unnest([n.x_m, n.y_m, n.yaw_rad, n.speed_mps]) as n_value
    from replay r join observations o using (shard, rollout_id)
    join observations n on n.shard = r.shard and n.rollout_id = r.nominal_rollout_id and n.tick = o.tick
    union all
    select r.shard, r.rollout_id, r.group_id, e.tick, 'evidence',
        unnest(['num_actors', 'separation_m', 'nearest_vehicle_gap_m', 'nearest_pedestrian_gap_m']),
        unnest([e.num_actors, e.separation_m, e.nearest_vehicle_gap_m, e.nearest_pedestrian_gap_m]),
        unnest([n.num_actors, n.separation_m, n.nearest_vehicle_gap_m, n.nearest_pedestrian_gap_m])
    from replay r join evidence e using (shard, rollout_id)
    join evidence n on n.shard = r.shard and n.rollout_id = r.nominal_rollout_id and n.tick = e.tick
);
