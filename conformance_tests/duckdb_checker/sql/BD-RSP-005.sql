-- subjects: (from driven_group where (select count(*) from driven_group) > 1)
with drive as (
    select r.group_id, md5(list(row(tick, x_m, y_m, yaw_rad, speed_mps) order by tick)::varchar) as digest
    from rollouts r join observations o using (run)
    group by r.run, r.group_id having count(*) > 16
)
select distinct d.group_id
from drive d join drive e on d.digest = e.digest and encode(d.group_id) > encode(e.group_id)
