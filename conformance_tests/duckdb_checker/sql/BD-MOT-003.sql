-- subjects: attempt
with wrong as (
    select rollout_id, group_id, tick, case
        when abs(accel_longitudinal_mps2::double - (speed_mps::double - v_0) / 0.25) > $acceleration_mps2
            then 'accel_longitudinal_mps2'
        when abs(accel_lateral_mps2::double - speed_mps::double * yaw_rate_radps) > $acceleration_mps2
            then 'accel_lateral_mps2' end as "column"
    from step
    union all
    select rollout_id, group_id, tick, case
        when accel_longitudinal_mps2 <> 0 then 'accel_longitudinal_mps2'
        when accel_lateral_mps2 <> 0 then 'accel_lateral_mps2'
        when yaw_rate_radps <> 0 then 'yaw_rate_radps' end
    from observation where tick = 0
)
select rollout_id, group_id, 'observations' as "table", min_by("column", tick) as "column", min(tick) as tick
from wrong where "column" is not null
group by rollout_id, group_id
