-- subjects: attempt
select rollout_id, group_id, 'controls' as "table", min(tick) as tick
from (
    select a.rollout_id, a.group_id, c.tick, row_number() over (partition by a.run order by c.tick) - 1 as i
    from attempt a left join controls c using (run)
)
where tick is distinct from i
group by all
