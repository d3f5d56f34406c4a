-- subjects: collisions where is_counted and (touches or whole and is_shown)
with tallied as (
    select run, rollout_id, group_id,
        result_num_vehicle_collisions + result_num_pedestrian_collisions + result_num_static_collisions = 0 as clean,
        greatest(result_num_vehicle_collisions, result_num_pedestrian_collisions, result_num_static_collisions) > 0 as counted,
        result_num_vehicle_collisions + result_num_pedestrian_collisions > 0 and result_num_static_collisions = 0 as by_users
    from attempt
), seen as (
    select run, o.tick, e.tick is not null as is_there, coalesce(e.collision, false) as touches, e.separation_m
    from tallied join observations o using (run) left join evidence e using (run, tick)
), contacts as (
    select run, min(tick) as contact_tick from evidence where collision group by run
), near as (
    select run, bool_or(coalesce(separation_m <= $contact_reach_m, false)) as is_near
    from seen join contacts using (run) where tick in (contact_tick, contact_tick - 5) group by run
), unnamed as (
    select run, max(kind) as kind from plain_contact group by run
), shown as (
    select run, bool_and(is_there) as whole, bool_or(touches) as touched from seen group by run
), judged as (
    select *, clean and coalesce(touched, false) or counted and coalesce(whole, true) and not coalesce(touched, false) as differs,
        not coalesce(counted, false) and whole and not touched and overlap_tick is not null as ignores,
        by_users and contact_tick is not null and not is_near as is_far, kind is not null as is_unnamed
    from tallied left join shown using (run) left join overlapped using (run)
    left join contacts using (run) left join near using (run) left join unnamed using (run)
)
select rollout_id, group_id, if(differs or is_unnamed and not coalesce(is_far, false), 'rollouts', 'evidence') as "table",
    case when differs then 'result_num_vehicle_collisions' when is_unnamed and not coalesce(is_far, false)
        then 'result_num_' || kind || '_collisions' else 'collision' end as "column",
    case when not coalesce(differs, false) then if(ignores, overlap_tick, case when is_far then contact_tick end) end as tick
from judged where differs or ignores or is_far or is_unnamed
