-- subjects: attempt
select rollout_id, group_id, 'observations' as "table", 'yaw_rad' as "column", min(tick) as tick
from step
where abs(wrap(yaw_rad::double - yaw_0 - (w_0::double + yaw_rate_radps) * 0.25 / 2)) > $turn_rad
group by all
