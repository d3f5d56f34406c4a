-- subjects: surveyed where run in (select run from evidence semi join observations using (run, tick))
with judged as (
    select e.rollout_id, a.group_id, e.tick, e.on_road,
        coalesce(bool_or(does_hold), false) as must, coalesce(bool_or(may_hold), false) as may
    from evidence e join surveyed a using (run) join observations o using (run, tick)
    join place p on p.shard = a.shard and p.town = a.town and p.x = o.x_m and p.y = o.y_m
    left join held h using (place)
    group by e.run, e.rollout_id, a.group_id, e.tick, e.on_road
)
select rollout_id, group_id, 'evidence' as "table", 'on_road' as "column", min(tick) as tick
from judged where case when on_road then not may else must end
group by rollout_id, group_id
