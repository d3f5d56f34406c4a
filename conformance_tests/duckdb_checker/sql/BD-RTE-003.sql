-- subjects: attempt where role = 'nominal' and run in (select run from observation where tick - t_b between -80 and 50)
with driven as (
    select o.*
    from observation o join attempt a using (run)
    where a.role = 'nominal' and o.tick between o.t_b - 80 and o.t_b + 50
), away as (
    select rollout_id, group_id, 'route_offset_m' as "column", min(tick) as tick
    from driven where abs(route_offset_m) > $route_distance_m
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
