-- subjects: collisions where is_counted and (touches or whole and is_shown)
with tallied as (
    select run, rollout_id, group_id,
        result_num_vehicle_collisions + result_num_pedestrian_collisions + result_num_static_collisions = 0 as clean,
        greatest(result_num_vehicle_collisions, result_num_pedestrian_collisions, result_num_static_collisions) > 0 as counted,
        result_num_vehicle_collisions + result_num_pedestrian_collisions > 0 and result_num_static_collisions = 0 as by_users
    from attempt
), seen as (
    select run, o.tick, e.tick is not null as is_there, coalesce(e.collision, false) as touches, e.separation_m,
        coalesce(least(e.nearest_vehicle_gap_m, e.nearest_pedestrian_gap_m) = 0, false) as lies_inside
    from tallied join observations o using (run) left join evidence e using (run, tick)
), lasting as (
    select run, tick, count(*) filter (lies_inside) over latest = $contact_observations as lasts
    from seen
    window latest as (partition by run order by tick rows between cast($contact_observations as bigint) - 1 preceding and current row)
), overlapped as (
    select run, min(tick) as overlap_tick from lasting where lasts group by run
), contacts as (
    select run, min(tick) as contact_tick from evidence where collision group by run
), near as (
    select run, bool_or(coalesce(separation_m <= $contact_reach_m, false)) as is_near
    from seen join contacts using (run) where tick in (contact_tick, contact_tick - 5) group by run
), shown as (
    select run, bool_and(is_there) as whole, bool_or(touches) as touched from seen group by run
), judged as (
    select *, clean and coalesce(touched, false) or counted and coalesce(whole, true) and not coalesce(touched, false) as differs,
        clean and whole and overlap_tick is not null as ignores,
        by_users and contact_tick is not null and not is_near as is_far
    from tallied left join shown using (run) left join overlapped using (run)
    left join contacts using (run) left join near using (run)
)
select rollout_id, group_id, if(differs, 'rollouts', 'evidence') as "table",
    if(differs, 'result_num_vehicle_collisions', 'collision') as "column",
    case when not coalesce(differs, false) then if(ignores, overlap_tick, contact_tick) end as tick
from judged where differs or ignores or is_far
