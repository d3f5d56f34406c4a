-- subjects: attempt where t_b is not null
select a.rollout_id, a.group_id, 'rollouts' as "table", 'trigger_tick' as "column"
from attempt a
where t_b is not null and (trigger_tick < t_b or not exists (
    from controls c
    where c.shard = a.shard and c.tick = a.trigger_tick
        and c.rollout_id = case when a.role = 'nominal' then a.rollout_id else a.nominal_rollout_id end))
