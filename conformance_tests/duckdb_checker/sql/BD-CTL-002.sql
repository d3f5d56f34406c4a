-- subjects: attempt where role = 'intervention' and t_b is not null
select rollout_id, a.group_id, 'controls' as "table", 'active' as "column"
from attempt a left join controls c using (shard, rollout_id)
where role = 'intervention' and t_b is not null
group by shard, rollout_id, a.group_id, t_b, duration_ticks
having count(*) filter (active and tick >= t_b) <> duration_ticks
    or count(*) filter (active and tick >= t_b and tick < t_b + duration_ticks) <> duration_ticks
