-- subjects: (from outlined where (select count(*) from outlined) > 1)
with origin as (
    select distinct group_id, nominal_run, t_b, x_m as x_0, y_m as y_0, cos(yaw_rad::double) as c, sin(yaw_rad::double) as s
    from effect join observations o on o.run = nominal_run and o.tick = t_b
), placed as (
    select group_id, 'nominal ' || (tick - t_b) as what, x_m, y_m, speed_mps::double as further
    from origin join observations on run = nominal_run
    where tick - t_b in (-75, -50, -25, 0, 25, 50)
    union all
    select e.group_id, e.action_key, x_m, y_m, 0
    from effect e join observations o on o.run = e.run and o.tick = e.t_b + 50
    union all
    select group_id, 'actors', avg(x_m), avg(y_m), count(*)
    from origin join actors on run = nominal_run and tick = t_b
    group by group_id
), outline as (
    select group_id, what, further,
        c * (x_m - x_0) + s * (y_m - y_0) as ahead, c * (y_m - y_0) - s * (x_m - x_0) as aside
    from placed join origin using (group_id)
    where group_id in (select group_id from placed where what = 'actors')
)
select distinct a.group_id
from outline a join outline b using (what)
where encode(a.group_id) > encode(b.group_id)
group by a.group_id, b.group_id
having max(greatest(abs(a.ahead - b.ahead), abs(a.aside - b.aside), abs(a.further - b.further))) <= $copy_m
