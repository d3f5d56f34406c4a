-- subjects: attempt where run in (select run from observations)
with driven as (
    select run, max(route_progress_m) as furthest, max(abs(route_offset_m)) as away,
        min(abs(speed_mps)) filter (from_the_end <= 8) as slowest
    from (select *, row_number() over (partition by run order by tick desc) as from_the_end from observations)
    group by run
), judged as (
    select a.*, abs(result_route_fraction * total - furthest) > $route_fraction * total + $route_end_m
            or (result_completion = 'completed' and result_route_fraction < 1 - $route_fraction) as misses,
        (result_completion = 'blocked' and slowest > $driving_mps)
            or (result_completion = 'deviated' and away <= $deviated_m) as contradicts
    from attempt a join attempt_route using (run) join driven using (run)
)
select rollout_id, group_id, 'rollouts' as "table",
    if(contradicts and not (result_completion = 'completed' and misses), 'result_completion', 'result_route_fraction') as "column"
from judged where misses or contradicts
