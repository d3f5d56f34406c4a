-- subjects: (from attempt semi join (from moved where is_free) using (run))
select rollout_id, group_id, 'actors' as "table", 'vel_x_mps' as "column", min(tick) as tick,
    first(actor_id order by tick, actor_id) as actor_id
from moved where is_free and is_broken
group by rollout_id, group_id
