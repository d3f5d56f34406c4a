-- subjects: attempt
with body as (
    select run, rollout_id, group_id, null as tick, null as actor_id, 'vehicle' as class, 'ego_' as prefix,
        ego_length_m as length_m, ego_width_m as width_m, ego_height_m as height_m
    from attempt
    union all
    select run, rollout_id, group_id, tick, actor_id, actor_class, '', length_m, width_m, height_m
    from track where actor_class <> 'static'
), bounded as (
    select *,
        case class when 'vehicle' then $vehicle_length_m when 'cycle' then $cycle_m else $pedestrian_m end as longest,
        case class when 'vehicle' then $vehicle_section_m when 'cycle' then $cycle_m else $pedestrian_m end as widest
    from body
), wrong as (
    select *, prefix || case
        when length_m not between $body_m and longest then 'length_m'
        when width_m not between $body_m and widest then 'width_m'
        when height_m > widest then 'height_m' end as "column"
    from bounded where "column" is not null
)
select rollout_id, group_id, if(tick is null, 'rollouts', 'actors') as "table", "column", tick, actor_id
from wrong
qualify row_number() over (partition by run order by tick nulls first, actor_id) = 1
