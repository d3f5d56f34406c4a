-- subjects: attempt
with tallied as (
    select a.*, result_num_vehicle_collisions + result_num_pedestrian_collisions + result_num_static_collisions = 0 as clean,
        greatest(result_num_vehicle_collisions, result_num_pedestrian_collisions, result_num_static_collisions) > 0 as counted
    from attempt a
), shown as (
    select c.rollout_id, c.group_id, clean, counted, coalesce(bool_or(e.collision), false) as touched,
        bool_and(e.tick is not null) as whole
    from tallied c left join observations o using (run) left join evidence e using (run, tick)
    group by c.run, c.rollout_id, c.group_id, clean, counted
)
select rollout_id, group_id, 'rollouts' as "table", 'result_num_vehicle_collisions' as "column"
from shown where (clean and touched) or (counted and whole and not touched)
