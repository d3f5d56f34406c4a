-- subjects: attempt where t_b is not null
select a.rollout_id, a.group_id, 'observations' as "table", min(due) as tick
from (select *, unnest(range(t_b - 80, t_b + 1, 5)) as due from attempt) as a
anti join observations o on o.run = a.run and o.tick = due
group by all
