-- subjects: surveyed where run in (select run from evidence semi join observations using (run, tick))
with judged as (
    select e.rollout_id, a.group_id, e.tick, e.lane_id,
        coalesce(bool_or(kind = 'lane' and does_hold), false) as must, coalesce(bool_or(kind = 'lane' and may_hold and h.lane_id = e.lane_id), false) as may
    from evidence e join surveyed a using (run) join observations o using (run, tick)
    join place p on p.shard = a.shard and p.town = a.town and p.x = o.x_m and p.y = o.y_m
    left join held h using (place)
    group by e.run, e.rollout_id, a.group_id, e.tick, e.lane_id
)
select rollout_id, group_id, 'evidence' as "table", 'lane_id' as "column", min(tick) as tick
from judged where case when lane_id is null then must else not may end
group by rollout_id, group_id
