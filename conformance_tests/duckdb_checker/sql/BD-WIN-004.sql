-- subjects: attempt where t_b is not null
select a.rollout_id, a.group_id, 'evidence' as "table", min(due) as tick
from (select *, unnest(range(t_b - 75, t_b + 51, 5)) as due from attempt) as a
anti join evidence e on e.run = a.run and e.tick = due
group by all
