-- subjects: attempt
with way as (
    select *, (abs(v_0::double) + abs(speed_mps::double)) * 0.25 / 2 as s,
        x_m - x_0 - (v_0 * cos(yaw_0::double) + speed_mps * cos(yaw_rad::double)) * 0.25 / 2 as off_x,
        y_m - y_0 - (v_0 * sin(yaw_0::double) + speed_mps * sin(yaw_rad::double)) * 0.25 / 2 as off_y
    from step
)
select rollout_id, group_id, 'observations' as "table", 'x_m' as "column", min(tick) as tick
from way where sqrt(off_x * off_x + off_y * off_y) > $displacement_m + $displacement_share * s
group by all
