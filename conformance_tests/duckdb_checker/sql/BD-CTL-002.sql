-- subjects: attempt where role = 'intervention' and t_b is not null
select a.rollout_id, a.group_id, 'controls' as "table", 'active' as "column"
from attempt a left join controls c using (run)
where role = 'intervention' and t_b is not null
group by a.run, a.rollout_id, a.group_id, t_b, duration_ticks
having count(*) filter (active and tick >= t_b) <> duration_ticks
    or count(*) filter (active and tick >= t_b and tick < t_b + duration_ticks) <> duration_ticks
