-- subjects: attempt where run in (select run from evidence semi join observations using (run, tick))
with bounds as (
    select e.*, a.group_id,
        min(r.gap) filter (is_near and actor_class in ('vehicle', 'cycle')) as vehicle,
        min(r.gap) filter (is_near and actor_class = 'pedestrian') as pedestrian
    from evidence e join attempt a using (run)
    left join relevant r using (run, tick)
    group by all
), judged as (
    select b.rollout_id, b.group_id, b.tick, case
        when not nearest_vehicle_available and vehicle is not null then 'nearest_vehicle_gap_m'
        when nearest_vehicle_available and not exists (
            from relevant r
            where r.run = b.run and r.tick = b.tick and may_near
                and actor_class in ('vehicle', 'cycle') and r.gap <= coalesce(vehicle, r.gap)
                and abs(nearest_vehicle_gap_m - r.gap) <= $evidence + $evidence * r.gap) then 'nearest_vehicle_gap_m'
        when nearest_vehicle_available and not exists (
            from relevant r
            where r.run = b.run and r.tick = b.tick and may_near
                and actor_class in ('vehicle', 'cycle')
                and abs(nearest_vehicle_gap_m - r.gap) <= $evidence + $evidence * r.gap
                and abs(nearest_vehicle_rel_speed_mps - r.closing) <= $evidence + $evidence * abs(r.closing))
            then 'nearest_vehicle_rel_speed_mps'
        when not nearest_pedestrian_available and pedestrian is not null then 'nearest_pedestrian_gap_m'
        when nearest_pedestrian_available and not exists (
            from relevant r
            where r.run = b.run and r.tick = b.tick and may_near
                and actor_class = 'pedestrian' and r.gap <= coalesce(pedestrian, r.gap)
                and abs(nearest_pedestrian_gap_m - r.gap) <= $evidence + $evidence * r.gap) then 'nearest_pedestrian_gap_m'
        end as "column"
    from bounds b
)
select rollout_id, group_id, 'evidence' as "table", min_by("column", tick) as "column", min(tick) as tick
from judged where "column" is not null
group by rollout_id, group_id
