-- subjects: surveyed
with judged as (
    select o.rollout_id, a.group_id, o.tick,
        bool_or(does_hold and h.speed_limit_mps is not null) as must,
        bool_or(may_hold and (h.speed_limit_mps is null or abs(h.speed_limit_mps::double - o.speed_limit_mps) <= 0.01)) as may
    from observations o join surveyed a using (run)
    join place p on p.shard = a.shard and p.town = a.town and p.x = o.x_m and p.y = o.y_m
    join held h on h.place = p.place and h.kind = 'lane'
    where o.speed_limit_mps is not null
    group by o.run, o.rollout_id, a.group_id, o.tick
)
select rollout_id, group_id, 'observations' as "table", 'speed_limit_mps' as "column", min(tick) as tick
from judged where must and not may
group by rollout_id, group_id
