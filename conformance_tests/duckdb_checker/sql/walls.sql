-- Parts of walls inside the ego's box, less a margin on every side, at the rows of evidence (spec/05-raw-streams.md#map).
create or replace temp table inside_ego as
with barrier as (
    select shard, town, unnest(range(1, len(x_m))) as i, x_m[i] as a_x, y_m[i] as a_y, x_m[i + 1] as b_x, y_m[i + 1] as b_y
    from map where kind = 'wall'
), placed as (
    select a.run, a.rollout_id, a.group_id, a.shard, a.town, o.tick, e.collision, w.a_x, w.a_y, w.b_x, w.b_y,
        ego_length_m::double / 2 - $wall_margin_m as half_x, ego_width_m::double / 2 - $wall_margin_m as half_y,
        cos(o.yaw_rad::double) as c, sin(o.yaw_rad::double) as s,
        (a_x - o.x_m) * c + (a_y - o.y_m) * s as px, (a_y - o.y_m) * c - (a_x - o.x_m) * s as py,
        (b_x - a_x) * c + (b_y - a_y) * s as qx, (b_y - a_y) * c - (b_x - a_x) * s as qy
    from attempt a join observations o using (run) join evidence e using (run, tick)
    join barrier w on w.shard = a.shard and w.town = a.town
        and least(a_x, b_x) <= o.x_m + ego_length_m + ego_width_m and greatest(a_x, b_x) >= o.x_m - ego_length_m - ego_width_m
        and least(a_y, b_y) <= o.y_m + ego_length_m + ego_width_m and greatest(a_y, b_y) >= o.y_m - ego_length_m - ego_width_m
), clipped as (
    select *,
        greatest(0,
            case when qx <> 0 then least((-half_x - px) / qx, (half_x - px) / qx) when abs(px) < half_x then 0 else 2 end,
            case when qy <> 0 then least((-half_y - py) / qy, (half_y - py) / qy) when abs(py) < half_y then 0 else 2 end) as enters,
        least(1,
            case when qx <> 0 then greatest((-half_x - px) / qx, (half_x - px) / qx) else 1 end,
            case when qy <> 0 then greatest((-half_y - py) / qy, (half_y - py) / qy) else 1 end) as leaves
    from placed where half_x > 0 and half_y > 0
)
select *, a_x + (enters + leaves) / 2 * (b_x - a_x) as x, a_y + (enters + leaves) / 2 * (b_y - a_y) as y
from clipped where enters < leaves;
