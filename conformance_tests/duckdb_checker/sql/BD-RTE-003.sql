-- subjects: attempt where role = 'nominal' and t_b is not null
with driven as (
    select o.*, o.tick < c.first_tick as is_free
    from observation o join attempt a using (run) join contact c using (run)
    where a.role = 'nominal' and o.tick between o.t_b - 80 and o.t_b + 50
), away as (
    select rollout_id, group_id, 'route_offset_m' as "column", min(tick) as tick
    from driven where is_free and abs(route_offset_m) > $route_distance_m
    group by rollout_id, group_id
), against as (
    select rollout_id, group_id, 'route_heading_error_rad' as "column", min(tick) as tick
    from driven where speed_mps > $driving_mps
    group by rollout_id, group_id
    having count(*) >= 8 and min(abs(route_heading_error_rad)) >= pi() / 2
)
select rollout_id, group_id, 'observations' as "table", "column", tick
from (from away union all from against)
qualify row_number() over (partition by rollout_id order by tick, "column" desc) = 1
