-- subjects: (from attempt semi join track using (run))
with seen as (
    select *, lag(tick) over before as tick_0, lag(x_m) over before as x_0, lag(y_m) over before as y_0
    from track window before as (partition by run, actor_id order by tick)
), missing as (
    select *, unnest(range(tick_0 + 5, tick, 5)) as due from seen
)
select m.rollout_id, m.group_id, 'actors' as "table", 'actor_id' as "column", min(m.tick) as tick,
    first(m.actor_id order by m.tick, m.actor_id) as actor_id
from missing m join observation o on o.run = m.run and o.tick = due
where sqrt(pow(m.x_0 + (m.x_m - m.x_0) * (due - tick_0) / (m.tick - tick_0) - o.x_m, 2)
         + pow(m.y_0 + (m.y_m - m.y_0) * (due - tick_0) / (m.tick - tick_0) - o.y_m, 2))
    < 50 - greatest($gap_margin_m, $road_user_mps2 * (due - tick_0) * (m.tick - due) * 0.05 * 0.05 / 2)
group by m.rollout_id, m.group_id
