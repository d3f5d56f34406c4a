-- subjects: attempt where t_b is not null
select rollout_id, group_id, first("table" order by "table" desc) as "table",
    first(due order by "table" desc, due) as tick
from (
    select a.rollout_id, a.group_id, 'controls' as "table", due
    from (select *, unnest(range(t_b, t_b + 51)) as due from attempt) as a
    anti join controls c on c.run = a.run and c.tick = due
    union all
    select a.rollout_id, a.group_id, 'observations', due
    from (select *, unnest(range(t_b + 5, t_b + 51, 5)) as due from attempt) as a
    anti join observations o on o.run = a.run and o.tick = due
)
group by rollout_id, group_id
