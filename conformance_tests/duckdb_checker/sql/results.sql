-- What attempts count of infractions, and what their evidence and the maps of their towns show of them.
create or replace temp table moment as
select e.*, p.on_road as was_on_road, p.traffic_light_available as was_governed, p.traffic_light as light_before
from evidence e join attempt a using (run) left join evidence p on p.run = e.run and p.tick = e.tick - 5;

-- Attempts that count stop signs and come near none of those of their town, all of which are whole.
create or replace temp table far_from_signs as
with sign as (
    select m.shard, m.town, x_m[1] as x, y_m[1] as y, element_id in (select element_id from faulty_element f where f.town = m.town) as is_faulty
    from map m where kind = 'stop_sign'
)
select run from attempt a
where result_num_stop_sign_infractions > 0
    and exists (from sign s where s.shard = a.shard and s.town = a.town)
    and not exists (from sign s where s.shard = a.shard and s.town = a.town and is_faulty)
    and not exists (
        from sign s join observations o on o.run = a.run
        where s.shard = a.shard and s.town = a.town and sqrt(pow(o.x_m - s.x, 2) + pow(o.y_m - s.y, 2)) <= $sign_m);

create or replace temp table infraction as
with seen as (
    select run, count(*) as rows_of_evidence, count(*) filter (not on_road and was_on_road is distinct from false) as left_road,
        bool_or(traffic_light = 'red' or (not traffic_light_available and coalesce(was_governed, false))) as lit,
    from moment group by run
), observed as (
    select run, count(*) as num_observed from observations group by run
)
select run, rollout_id, group_id, result_num_off_road_infractions as off_road, result_num_red_light_infractions as red,
    result_num_stop_sign_infractions as stop, off_road is not null as departures, red is not null as lights,
    stop is not null as stops, $has_evidence and coalesce(rows_of_evidence, 0) >= coalesce(num_observed, 0) as whole,
    coalesce(left_road, 0) as left_road, coalesce(lit, false) as lit, $has_map as has_map,
    $has_map and not exists (from map m where m.shard = a.shard and m.town = a.town and m.kind = 'signal') as no_signal,
    $has_map and not exists (from map m where m.shard = a.shard and m.town = a.town and m.kind = 'stop_sign') as no_sign,
    run in (select run from far_from_signs) as is_far
from attempt a left join seen using (run) left join observed using (run);

-- Attempts that leave signals: whether they run a red light, and whether they may run one, as it is not green at the end.
create or replace temp table passed as
with light as (
    select m.run, not m.traffic_light_available and coalesce(m.was_governed, false) as is_left,
        coalesce(m.light_before = 'red', false) as was_red, coalesce(abs(o.speed_mps) > $driving_mps, false) as is_fast,
        m.traffic_light_available and m.traffic_light is distinct from 'green'
            and not coalesce(n.traffic_light_available and n.lane_id = m.lane_id, false) as is_last_stop
    from moment m left join observations o on o.run = m.run and o.tick = m.tick
        left join evidence n on n.run = m.run and n.tick = m.tick + 5
), leaving as (
    select run, bool_or(is_left) as leaves, bool_or(is_left and was_red and is_fast) as runs,
        bool_or(coalesce(is_last_stop, false)) as may_run
    from light group by run
)
select run, rollout_id, group_id, red = 0 and runs or red > 0 and whole and leaves and not may_run as is_wrong
from infraction join leaving using (run) where lights and (runs or red > 0 and whole and leaves);

-- Rows of evidence at which the box of a road user overlaps, of whose kind no collision is counted.
create or replace temp table uncounted_overlap as
select run, tick, collision, 'vehicle' as kind, nearest_pedestrian_gap_m as other_gap_m
from evidence e join attempt a using (run) where nearest_vehicle_gap_m = 0 and result_num_vehicle_collisions = 0
union all
select run, tick, collision, 'pedestrian', nearest_vehicle_gap_m
from evidence e join attempt a using (run) where nearest_pedestrian_gap_m = 0 and result_num_pedestrian_collisions = 0;

create or replace temp table overlapped as  -- where it lasts
with lying as (
    select run, tick, (run, tick) in (select (run, tick) from uncounted_overlap) as lies_inside from observations
), lasting as (
    select run, tick, count(*) filter (lies_inside) over latest = $contact_observations as lasts
    from lying
    window latest as (partition by run order by tick rows between cast($contact_observations as bigint) - 1 preceding and current row)
)
select run, min(tick) as overlap_tick from lasting where lasts group by run;

create or replace temp table plain_contact as  -- where nobody else who is recorded is near the contact
select run, kind from uncounted_overlap u join observations o using (run, tick) join attempt a using (run)
where collision and coalesce(other_gap_m > $contact_reach_m, true) and not exists (
    from actors c where c.run = u.run and c.tick = u.tick and c.actor_class = 'static'
        and sqrt(pow(c.x_m - o.x_m, 2) + pow(c.y_m - o.y_m, 2)) <= $contact_reach_m
            + (sqrt(pow(c.length_m::double, 2) + pow(c.width_m::double, 2))
                + sqrt(pow(a.ego_length_m::double, 2) + pow(a.ego_width_m::double, 2))) / 2);

-- What attempts count of collisions, and whether evidence tells of all their contacts, or of any.
create or replace temp table collisions as
select run, a.rollout_id, result_num_vehicle_collisions as vehicles, result_num_pedestrian_collisions as pedestrians,
    vehicles + pedestrians + result_num_static_collisions is not null
        or coalesce(greatest(vehicles, pedestrians, result_num_static_collisions) > 0, false)
        or run in (select run from overlapped) or run in (select run from plain_contact) as is_counted,
    whole, run in (select run from evidence) as is_shown, run in (select run from evidence where collision) as touches
from attempt a join infraction using (run);
