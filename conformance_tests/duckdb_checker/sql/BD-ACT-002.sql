-- subjects: (from attempt semi join track using (run))
with beginning as (
    select t.* from track t
    semi join (select run, begin_tick as tick from track) as begins using (run, tick)
), wrong as (
    select t.rollout_id, t.group_id, t.tick, t.actor_id, 'x_m' as "column"
    from beginning t
    join observation o using (run, tick)
    where t.tick = t.begin_tick and sqrt(pow(t.x_m - o.x_m, 2) + pow(t.y_m - o.y_m, 2)) <= $same_centre_m
    union all
    select rollout_id, group_id, tick, max(actor_id), 'actor_id'
    from beginning
    group by run, rollout_id, group_id, tick, x_m, y_m, yaw_rad, length_m, width_m
    having count(*) > 1
    union all
    select b.rollout_id, b.group_id, b.tick, greatest(b.actor_id, o.actor_id), 'actor_id'
    from beginning b join beginning o using (run, tick, actor_class)
    where b.tick = b.begin_tick and b.actor_id <> o.actor_id and abs(b.x_m - o.x_m) <= $body_m and abs(b.y_m - o.y_m) <= $body_m
        and abs(b.length_m::double - o.length_m) <= $body_m and abs(b.width_m::double - o.width_m) <= $body_m
)
select rollout_id, group_id, 'actors' as "table", first("column" order by tick, actor_id) as "column",
    min(tick) as tick, first(actor_id order by tick, actor_id) as actor_id
from wrong group by rollout_id, group_id
