-- subjects: (from attempt semi join returned using (run))
select rollout_id, group_id, 'actors' as "table", 'actor_id' as "column", min(tick) as tick,
    first(actor_id order by tick, actor_id) as actor_id
from returned
where sqrt(pow(x_m - x_0 - way_x, 2) + pow(y_m - y_0 - way_y, 2)) > $displacement_m
    + $displacement_share * sqrt(way_x * way_x + way_y * way_y) + $road_user_mps2 * gone * gone / 4
group by rollout_id, group_id
