-- subjects: attempt where role = 'drive' and run in (select run from control)
with latest as (
    select c.*, p.duration_ticks, d.tick = min(d.tick) over (partition by c.run) as is_first,
        c.tick < d.tick + p.duration_ticks as is_active, p.* exclude (key, duration_ticks, recovery)
    from control c
    asof left join decisions d on d.run = c.run and c.tick >= d.tick
    left join policy p on p.key = d.action_key
    where c.role = 'drive'
), copied as (
    select l.*, case when is_first then n.applied_steer else expert_steer end as stored_steer,
        case when is_first then n.applied_throttle else expert_throttle end as stored_throttle,
        case when is_first then n.applied_brake else expert_brake end as stored_brake
    from latest l
    left join (select run as other, tick as at, applied_steer, applied_throttle, applied_brake from controls) n
        on n.other = l.nominal_run and n.at = l.tick
), demanded as (
    select run, rollout_id, group_id, tick, active, coalesce(is_active, false) as is_active, unnest([
        {'rule': steer_rule, 'value': steer_value, 'expert': expert_steer, 'stored': stored_steer,
            'nominal': nominal_steer, 'intended': intended_steer, 'applied': applied_steer},
        {'rule': throttle_rule, 'value': throttle_value, 'expert': expert_throttle, 'stored': stored_throttle,
            'nominal': nominal_throttle, 'intended': intended_throttle, 'applied': applied_throttle},
        {'rule': brake_rule, 'value': brake_value, 'expert': expert_brake, 'stored': stored_brake,
            'nominal': nominal_brake, 'intended': intended_brake, 'applied': applied_brake}], recursive := true)
    from copied
), judged as (
    select *, case rule when 'online_expert' then expert when 'stored_nominal' then stored when 'zero' then 0::float
        when 'absolute' then value else greatest(expert, value) end as command
    from demanded
)
select rollout_id, group_id, 'controls' as "table", min(tick) as tick
from judged
where active <> is_active or (is_active and (nominal is distinct from stored or intended is distinct from command
    or abs(applied::double - command::double) > $actuator or command is null))
group by all
