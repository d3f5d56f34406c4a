-- subjects: collisions where (vehicles is not null or pedestrians is not null) and whole and touches
with apart as (
    select run, count(*) as contacts from (
        select run, tick - lag(tick) over (partition by run order by tick) as since from moment where collision
    ) where since is null or since >= 30 group by run
), within_reach as (  -- actors that a contact may be with: then, or at the observation before
    select distinct e.run, e.tick, g.actor_id, if(g.actor_class = 'cycle', 'vehicle', g.actor_class) as kind
    from moment e join gap g on g.run = e.run and g.tick in (e.tick, e.tick - 5)
    where e.collision and g.gap <= least($contact_reach_m, $edge_m + sqrt(g.vel_x * g.vel_x + g.vel_y * g.vel_y) / 4)
), near as (
    select run, count(*) filter (kind = 'vehicle') as vehicles, count(*) filter (kind = 'pedestrian') as pedestrians
    from within_reach group by run
), judged as (
    select rollout_id, group_id, result_num_vehicle_collisions as v, result_num_pedestrian_collisions as p,
        result_num_static_collisions as s, v + p + s < contacts as fewer, coalesce(v > coalesce(vehicles, 0), false) as more,
        coalesce(p > coalesce(pedestrians, 0), false) as more_people
    from infraction join attempt using (run, rollout_id, group_id) join apart using (run) left join near using (run)
    where whole
)
select rollout_id, group_id, 'rollouts' as "table",
    if(not more and more_people and not coalesce(fewer, false), 'result_num_pedestrian_collisions', 'result_num_vehicle_collisions')
        as "column"
from judged where fewer or more or more_people
