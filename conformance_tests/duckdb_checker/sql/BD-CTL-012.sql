-- subjects: attempt where role = 'intervention' and t_b is not null
select a.rollout_id, a.group_id, 'controls' as "table", a.t_b + a.duration_ticks as tick
from attempt a
where role = 'intervention' and t_b is not null and (a.recovery <> 'online_expert' or not exists (
    from controls c
    where c.run = a.run and c.tick = a.t_b + a.duration_ticks
        and not c.active and c.source = 'online_expert'))
