-- subjects: attempt where run in (select run from observation where tick - t_b between -75 and 50 and (tick - t_b) % 5 = 0)
select a.rollout_id, a.group_id, 'frames' as "table", min(due) as tick
from (
    select *, unnest(range(t_b - 75, t_b + 51, 5)) as due, camera
    from attempt cross join (
        values ('front'), ('front_left'), ('front_right'), ('rear'), ('rear_left'), ('rear_right')
    ) as surround (camera)
) as a
semi join observations o on o.run = a.run and o.tick = due
anti join frames f on f.run = a.run and f.tick = due and f.camera = a.camera
group by all
