-- subjects: attempt where $single_axis and run in (select run from control)
select rollout_id, group_id, 'controls' as "table", min_by("column", tick) as "column", min(tick) as tick
from (
    select rollout_id, group_id, tick, case
        when least(expert_throttle, expert_brake)::double > $actuator then 'expert_throttle'
        when least(applied_throttle, applied_brake)::double > $actuator then 'applied_throttle' end as "column"
    from control
)
where "column" is not null and $single_axis
group by rollout_id, group_id
