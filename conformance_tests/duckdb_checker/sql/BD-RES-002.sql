-- subjects: attempt
select a.rollout_id, a.group_id, 'rollouts' as "table", 'result_route_fraction' as "column"
from attempt a join attempt_route using (run) join observations o using (run)
group by a.run, a.rollout_id, a.group_id, result_route_fraction, result_completion, total
having abs(result_route_fraction * total - max(route_progress_m)) > $route_fraction * total + $route_end_m
    or (result_completion = 'completed' and result_route_fraction < 1 - $route_fraction)
