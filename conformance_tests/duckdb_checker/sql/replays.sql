-- Values in which nominal replays are compared with their nominal, one row for each value that both have.
create or replace temp table replay as
select run, shard, rollout_id, group_id, nominal_run from attempt where role = 'nominal_replay'
    and rollout_id not in (select rollout_id from failed where rule = 'BD-GRP-006');

create or replace temp table replayed as
select *, r_value is distinct from n_value or signbit(r_value) is distinct from signbit(n_value) as differs
from (
    select r.run, r.shard, r.rollout_id, r.group_id, o.tick, 'observations' as "table",
        unnest(['x_m', 'y_m', 'yaw_rad', 'speed_mps']) as "column",
        unnest([o.x_m, o.y_m, o.yaw_rad, o.speed_mps]) as r_value, unnest([n.x_m, n.y_m, n.yaw_rad, n.speed_mps]) as n_value
    from replay r join observations o using (run)
    join observations n on n.run = r.nominal_run and n.tick = o.tick
    union all
    select r.run, r.shard, r.rollout_id, r.group_id, e.tick, 'evidence',
        unnest(['num_actors', 'separation_m', 'nearest_vehicle_gap_m', 'nearest_pedestrian_gap_m']),
        unnest([e.num_actors, e.separation_m, e.nearest_vehicle_gap_m, e.nearest_pedestrian_gap_m]),
        unnest([n.num_actors, n.separation_m, n.nearest_vehicle_gap_m, n.nearest_pedestrian_gap_m])
    from replay r join evidence e using (run)
    join evidence n on n.run = r.nominal_run and n.tick = e.tick
);
