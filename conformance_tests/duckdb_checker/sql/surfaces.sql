-- Where the ego's centre lies on the elements of its map (spec/05-raw-streams.md#map).
-- Attempts in towns without a drivable surface that is faulty: what such a surface would hold is unknown.
create or replace temp table surveyed as
select * from attempt a where not exists (
    from map m semi join faulty_element using (town, element_id)
    where m.shard = a.shard and m.town = a.town and m.kind in ('lane', 'shoulder', 'parking', 'road_area'));

create or replace temp table place as
select row_number() over () as place, *
from (
    select a.shard, a.town, o.x_m as x, o.y_m as y
    from attempt a join observations o using (run)
    union
    select shard, town, x, y from inside_ego
);

create or replace temp table edge as
select shard, town, element_id, kind, lane_id, speed_limit_mps, i, n,
    x_m[i] as a_x, y_m[i] as a_y, x_m[i % n + 1] as b_x, y_m[i % n + 1] as b_y, width_m[i] as w_a, width_m[i % n + 1] as w_b
from (
    select *, len(x_m) as n,
        unnest(range(1, len(x_m) + case when kind = 'road_area' then 1 else 0 end)) as i
    from map where kind in ('lane', 'shoulder', 'parking', 'road_area')
);

-- Margin by which an element holds a place, below 0 outside; open where the nearest point is an end of a centre line.
create or replace temp table held as
with near as (
    select place, e.*, x, y,
        least(greatest(((x - a_x) * (b_x - a_x) + (y - a_y) * (b_y - a_y)) / (pow(b_x - a_x, 2) + pow(b_y - a_y, 2)), 0), 1) as share,
        sqrt(pow(x - a_x - share * (b_x - a_x), 2) + pow(y - a_y - share * (b_y - a_y), 2)) as distance
    from place join edge e using (shard, town)
), closest as (
    select place, shard, town, x, y, element_id, kind, lane_id, speed_limit_mps, min(distance) as distance,
        arg_min((1 - share) * w_a + share * w_b, distance) as width,
        arg_min((i = 1 and share <= 0) or (i = n - 1 and share >= 1), distance) as at_end,
        sum(case when (a_y > y) <> (b_y > y) and x < a_x + (y - a_y) / (b_y - a_y) * (b_x - a_x) then 1 else 0 end) % 2 = 1 as inside
    from near group by place, shard, town, x, y, element_id, kind, lane_id, speed_limit_mps
)
select *, case when kind = 'road_area' then case when inside then distance else -distance end
               else width / 2 - distance end as margin,
    margin >= -0.05 as may_hold,
    margin > 0.05 and (kind = 'road_area' or not at_end) as does_hold
from closest;

-- Observations with a speed limit beside those of the lanes that hold them.
create or replace temp table limited as
select run, o.rollout_id, a.group_id, o.tick, bool_or(may_hold and h.speed_limit_mps is not null) as is_compared,
    bool_or(does_hold and h.speed_limit_mps is not null) as must,
    bool_or(may_hold and (h.speed_limit_mps is null or abs(h.speed_limit_mps::double - o.speed_limit_mps) <= 0.01)) as may
from observations o join surveyed a using (run)
join place p on p.shard = a.shard and p.town = a.town and p.x = o.x_m and p.y = o.y_m
join held h on h.place = p.place and h.kind = 'lane'
where o.speed_limit_mps is not null
group by run, o.rollout_id, a.group_id, o.tick;

-- Lanes and stop lines of the towns of rollouts, whole ones.
create or replace temp table road_line as
select * from map m anti join faulty_element using (town, element_id)
where kind in ('lane', 'stop_line') and exists (from rollouts r where r.shard = m.shard and r.town = m.town);

-- Ends of lanes that meet ends of others: whether they are head-on, and whether the other one goes on in the lane.
create or replace temp table meeting as
with lane_end as (
    select shard, town, element_id, false as is_last, x_m[1] as x, y_m[1] as y,
        atan2(y_m[2] - y_m[1], x_m[2] - x_m[1]) as heading from road_line where kind = 'lane'
    union all
    select shard, town, element_id, true, x_m[-1], y_m[-1], atan2(y_m[-1] - y_m[-2], x_m[-1] - x_m[-2])
    from road_line where kind = 'lane'
)
select a.shard, a.town, a.element_id, a.is_last,
    a.is_last = b.is_last and cos(a.heading - b.heading) < -sqrt(0.5) as is_contrary,
    a.is_last <> b.is_last and cos(a.heading - b.heading) >= -sqrt(0.5) as goes_on
from lane_end a join lane_end b on b.shard = a.shard and b.town = a.town and b.element_id <> a.element_id
where sqrt(pow(a.x - b.x, 2) + pow(a.y - b.y, 2)) <= $meeting_m;

-- Stop lines that name lanes, all of which are whole, and how far their nearest vertex is from these.
create or replace temp table lined as
with line as (
    select l.shard, l.town, l.element_id, l.lane_id, unnest(x_m) as x, unnest(y_m) as y from road_line l
    where kind = 'stop_line' and lane_id in (select lane_id from road_line m where m.town = l.town and m.kind = 'lane')
        and not exists (
            from map m semi join faulty_element using (town, element_id)
            where m.town = l.town and m.kind = 'lane' and m.lane_id = l.lane_id)
)
select shard, town, l.element_id, min(sqrt(pow(x - a_x - share * (b_x - a_x), 2) + pow(y - a_y - share * (b_y - a_y), 2))) as away_m
from (
    select l.*, a_x, a_y, b_x, b_y,
        least(greatest(((x - a_x) * (b_x - a_x) + (y - a_y) * (b_y - a_y)) / (pow(b_x - a_x, 2) + pow(b_y - a_y, 2)), 0), 1) as share
    from line l join edge e on e.shard = l.shard and e.town = l.town and e.lane_id = l.lane_id and e.kind = 'lane'
) l
group by shard, town, l.element_id;
