-- subjects: attempt where t_b is not null
select a.rollout_id, a.group_id, 'rollouts' as "table", 'trigger_tick' as "column"
from attempt a
where t_b is not null and (trigger_tick < t_b or not exists (
    from controls c
    where c.tick = a.trigger_tick
        and c.run = case when a.role = 'nominal' then a.run else a.nominal_run end))
