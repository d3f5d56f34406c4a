-- subjects: branch_group
with drive as (
    select r.group_id, list(row(tick, x_m, y_m, yaw_rad, speed_mps) order by tick) as states
    from rollouts r join observations o using (run)
    where r.rollout_id not in (select rollout_id from faulty)
    group by r.run, r.rollout_id, r.group_id having count(*) > 16
)
select distinct d.group_id
from drive d join drive e on md5(d.states::varchar) = md5(e.states::varchar) and d.group_id > e.group_id
