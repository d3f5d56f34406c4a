-- subjects: attempt where run in (select run from observation where tick - t_b between -80 and 50)
with ordered as (
    select o.rollout_id, o.group_id, o.tick,
        min(f.s) filter (number = 1 and f.s >= f.progress - $route_tolerance_m - 1e-6 * f.progress) as first_s,
        max(f.s) filter (number = 2) as second_s, max(total) as total
    from observation o join attempt_route using (run) left join target_foot f using (id)
    where o.tick between o.t_b - 80 and o.t_b + 50
    group by o.id, o.rollout_id, o.group_id, o.tick
)
select rollout_id, group_id, 'observations' as "table", 'target_point_1_x_m' as "column", min(tick) as tick
from ordered where not coalesce(second_s >= least(first_s + $route_tolerance_m + 1e-6 * first_s,
    total - $route_tolerance_m - 1e-6 * total), false)
group by rollout_id, group_id
