-- subjects: attempt
with driven as (
    select run, max(tick) as last_tick, count(*) as num_ticks from control group by all
), expected as (
    select *, last_tick - last_tick % 5 as least,
        case when num_ticks % 5 = 0 and last_tick = num_ticks - 1 then num_ticks else last_tick - last_tick % 5 end as most
    from driven
), saved as (
    select a.run, a.rollout_id, a.group_id, o.tick,
        5 * (row_number() over (partition by a.run order by o.tick) - 1) as due
    from attempt a left join observations o using (run)
)
select rollout_id, group_id, 'observations' as "table",
    coalesce(min(tick) filter (tick <> due or tick > most), max(tick)) as tick
from saved left join expected using (run)
group by run, rollout_id, group_id
having bool_or(tick is distinct from due or tick > most) or max(tick) < any_value(least)
