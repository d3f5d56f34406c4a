-- Gap, closing speed and corridor of every actor at every evidence row of an attempt.
create or replace temp table facing as
select run, c.tick, c.actor_id, c.actor_class, route, a.ego_width_m::double as corridor,
    o.x_m as ego_x, o.y_m as ego_y, o.yaw_rad::double as ego_yaw, cos(o.yaw_rad::double) as ego_cos,
    sin(o.yaw_rad::double) as ego_sin, a.ego_length_m::double as ego_length, a.ego_width_m::double as ego_width,
    c.x_m as x, c.y_m as y, c.yaw_rad::double as yaw, cos(c.yaw_rad::double) as yaw_cos, sin(c.yaw_rad::double) as yaw_sin,
    c.length_m::double as length, c.width_m::double as width,
    c.vel_x_mps - o.speed_mps * cos(o.yaw_rad::double) as vel_x, c.vel_y_mps - o.speed_mps * sin(o.yaw_rad::double) as vel_y
from actors c join attempt a using (run) join attempt_route using (run)
join observations o using (run, tick)
semi join evidence using (run, tick);

-- Two rectangles are apart where one of their four axes separates them; touching is no separation.
create or replace temp table apart as
select *, cos(yaw - ego_yaw) as rel_cos, sin(yaw - ego_yaw) as rel_sin,
    (x - ego_x) * ego_cos + (y - ego_y) * ego_sin as in_ego_x,
    (y - ego_y) * ego_cos - (x - ego_x) * ego_sin as in_ego_y,
    (ego_x - x) * yaw_cos + (ego_y - y) * yaw_sin as in_box_x,
    (ego_y - y) * yaw_cos - (ego_x - x) * yaw_sin as in_box_y,
    abs(in_ego_x) > ego_length / 2 + abs(rel_cos) * length / 2 + abs(rel_sin) * width / 2
    or abs(in_ego_y) > ego_width / 2 + abs(rel_sin) * length / 2 + abs(rel_cos) * width / 2
    or abs(in_box_x) > length / 2 + abs(rel_cos) * ego_length / 2 + abs(rel_sin) * ego_width / 2
    or abs(in_box_y) > width / 2 + abs(rel_sin) * ego_length / 2 + abs(rel_cos) * ego_width / 2 as is_apart
from facing;

-- The gap of separate rectangles runs from a corner of the one to the nearest point of the other.
create or replace temp table gap as
with corner as (
    select unnest([-0.5, -0.5, 0.5, 0.5]) as front, unnest([-0.5, 0.5, -0.5, 0.5]) as side
), pair as (
    select run, tick, actor_id, ego_cos as frame_cos, ego_sin as frame_sin, ego_length as l, ego_width as w,
        in_ego_x + front * length * rel_cos - side * width * rel_sin as px,
        in_ego_y + front * length * rel_sin + side * width * rel_cos as py, 1 as sense
    from apart, corner where is_apart
    union all
    select run, tick, actor_id, yaw_cos, yaw_sin, length, width,
        in_box_x + front * ego_length * rel_cos + side * ego_width * rel_sin,
        in_box_y - front * ego_length * rel_sin + side * ego_width * rel_cos, -1
    from apart, corner where is_apart
), reach as (
    select *, px - least(greatest(px, -l / 2), l / 2) as dx, py - least(greatest(py, -w / 2), w / 2) as dy,
        sqrt(dx * dx + dy * dy) as distance
    from pair
), nearest as (
    select run, tick, actor_id, min(distance) as gap,
        arg_min(struct_pack(x := sense * (dx * frame_cos - dy * frame_sin), y := sense * (dx * frame_sin + dy * frame_cos)),
                distance) as way
    from reach group by run, tick, actor_id
)
select a.*, coalesce(n.gap, 0) as gap,
    case when n.gap > 0 then -(vel_x * way.x + vel_y * way.y) / n.gap else 0 end as closing
from apart a left join nearest n using (run, tick, actor_id);

-- Distance of every static box from its polyline: 0 where a segment enters the box, else from an end or a corner.
create or replace temp table static_box as
select distinct route, x, y, yaw_cos, yaw_sin, length, width from facing where actor_class = 'static';

create or replace temp table beside as
with placed as (
    select b.*, i, (a_x - x) * yaw_cos + (a_y - y) * yaw_sin as px, (a_y - y) * yaw_cos - (a_x - x) * yaw_sin as py,
        e_x * yaw_cos + e_y * yaw_sin as qx, e_y * yaw_cos - e_x * yaw_sin as qy
    from static_box b join segment g using (route)
), clipped as (
    select *,
        case when qx = 0 then case when abs(px) <= half_x then 0 else 2 end
             else least((-half_x - px) / qx, (half_x - px) / qx) end as in_x,
        case when qx = 0 then case when abs(px) <= half_x then 1 else -2 end
             else greatest((-half_x - px) / qx, (half_x - px) / qx) end as out_x,
        case when qy = 0 then case when abs(py) <= half_y then 0 else 2 end
             else least((-half_y - py) / qy, (half_y - py) / qy) end as in_y,
        case when qy = 0 then case when abs(py) <= half_y then 1 else -2 end
             else greatest((-half_y - py) / qy, (half_y - py) / qy) end as out_y
    from (select *, placed.length / 2 as half_x, placed.width / 2 as half_y from placed)
), cornered as (
    select *, unnest([-half_x, -half_x, half_x, half_x]) as cx, unnest([-half_y, half_y, -half_y, half_y]) as cy from clipped
), measured as (
    select *, least(greatest(((cx - px) * qx + (cy - py) * qy) / (qx * qx + qy * qy), 0), 1) as share from cornered
)
select route, x, y, yaw_cos, yaw_sin, length, width, min(case
    when greatest(in_x, in_y, 0) <= least(out_x, out_y, 1) then 0
    else least(beyond_box(px, py, length, width), beyond_box(px + qx, py + qy, length, width),
               sqrt(pow(cx - px - share * qx, 2) + pow(cy - py - share * qy, 2))) end) as distance
from measured group by all;

-- What counts surely, and what may count or not because it lies at a cut-off.
create or replace temp table relevant as
select g.*, b.distance - (corridor / 2 + 0.5) as outside,
    gap <= 50 + 1e-6 as may_near, gap <= 50 - 1e-6 as is_near,
    actor_class <> 'static' or outside <= 1e-6 as may_matter, actor_class <> 'static' or outside <= -1e-6 as does_matter,
    case when gap <= 1e-9 then 0 when closing > 0.1 - 1e-6 then gap / closing end as ttc,
    gap <= 0 or (gap > 1e-9 and closing > 0.1 + 1e-6) as does_close
from gap g left join beside b using (route, x, y, yaw_cos, yaw_sin, length, width);
