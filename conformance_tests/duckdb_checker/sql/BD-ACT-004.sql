-- subjects: attempt
with moved as (
    select n.*, n.x_m - p.x_m - (p.vel_x_mps::double + n.vel_x_mps) * 0.25 / 2 as off_x,
        n.y_m - p.y_m - (p.vel_y_mps::double + n.vel_y_mps) * 0.25 / 2 as off_y,
        sqrt(pow(p.vel_x_mps::double + n.vel_x_mps, 2) + pow(p.vel_y_mps::double + n.vel_y_mps, 2)) * 0.25 / 2 as way
    from track n join track p
        on p.run = n.run and p.actor_id = n.actor_id and p.tick = n.tick - 5
    join contact c on c.run = n.run and n.tick < c.first_tick
)
select rollout_id, group_id, 'actors' as "table", 'vel_x_mps' as "column", min(tick) as tick,
    first(actor_id order by tick, actor_id) as actor_id
from moved where sqrt(off_x * off_x + off_y * off_y) > $displacement_m + $displacement_share * way
group by rollout_id, group_id
