-- subjects: surveyed where (shard, town) in (select (shard, town) from map where kind = 'wall') and run in (select run from evidence semi join observations using (run, tick))
with touching as (
    select w.rollout_id, w.group_id, w.tick
    from inside_ego w semi join surveyed s on s.run = w.run left join held h on h.shard = w.shard and h.town = w.town and h.x = w.x and h.y = w.y
    where not w.collision
    group by w.run, w.rollout_id, w.group_id, w.tick, w.x, w.y
    having not coalesce(bool_or(h.margin > 0.05), false)
)
select rollout_id, group_id, 'evidence' as "table", 'collision' as "column", min(tick) as tick
from touching group by rollout_id, group_id
