-- Values in which nominal replays are compared with their nominal, one row for each value that both have.
create or replace temp table replay as
select a.run, a.shard, a.rollout_id, a.group_id, a.nominal_run
from attempt a join rollouts n on n.run = a.nominal_run and n.status = 'complete'
where a.role = 'nominal_replay' and a.rollout_id not in (select rollout_id from failed where rule = 'BD-GRP-006');

create or replace temp table replayed as
select *, coalesce(r_value, 0) <> coalesce(n_value, 0) as differs
from (
    select r.run, r.shard, r.rollout_id, r.group_id, o.tick, 'observations' as "table",
        unnest([1, 2, 3, 4]) as place, unnest(['x_m', 'y_m', 'yaw_rad', 'speed_mps']) as "column",
        unnest([o.x_m, o.y_m, o.yaw_rad, o.speed_mps]) as r_value, unnest([n.x_m, n.y_m, n.yaw_rad, n.speed_mps]) as n_value
    from replay r join observations o using (run)
    join observations n on n.run = r.nominal_run and n.tick = o.tick
    union all
    select r.run, r.shard, r.rollout_id, r.group_id, e.tick, 'evidence', unnest([5, 6, 7, 8]),
        unnest(['num_actors', 'separation_m', 'nearest_vehicle_gap_m', 'nearest_pedestrian_gap_m']),
        unnest([e.num_actors, e.separation_m, e.nearest_vehicle_gap_m, e.nearest_pedestrian_gap_m]),
        unnest([n.num_actors, n.separation_m, n.nearest_vehicle_gap_m, n.nearest_pedestrian_gap_m])
    from replay r join evidence e using (run)
    join evidence n on n.run = r.nominal_run and n.tick = e.tick
);
