-- subjects: attempt where t_b is not null
select a.rollout_id, a.group_id, 'controls' as "table", min(due) as tick
from (select *, unnest(range(t_b - 80, t_b)) as due from attempt) as a
anti join controls c on c.run = a.run and c.tick = due
group by all
