-- subjects: (from attempt semi join (from track where tick > begin_tick) using (run))
select rollout_id, group_id, 'actors' as "table", first("column" order by tick) as "column", min(tick) as tick,
    first(actor_id order by tick, actor_id) as actor_id
from (
    select t.rollout_id, t.group_id, t.tick, t.actor_id, case
        when t.actor_class <> b.actor_class then 'actor_class'
        when t.length_m <> b.length_m then 'length_m'
        when t.width_m <> b.width_m then 'width_m'
        when t.height_m <> b.height_m then 'height_m' end as "column"
    from track t join track b using (run, actor_id)
    where b.tick = b.begin_tick
)
where "column" is not null
group by rollout_id, group_id
