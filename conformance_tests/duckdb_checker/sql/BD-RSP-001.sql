-- subjects: (select 1 where exists (select 1 from effect where steers and not drives and abs(left_m) >= 0.1 having count(*) >= 8) or exists (select 1 from ordered where steers and not drives and abs(turn) >= 0.01 group by action_key, other having count(*) >= 3)) + (select 1 where exists (select 1 from effect where drives and not steers and abs(faster) >= 0.1 having count(*) >= 8) or exists (select 1 from ordered where drives and not steers and abs(accel) >= 2 group by action_key, other having count(*) >= 3))
select 'controls' as "table", 'applied_steer' as "column"
from effect where steers and not drives and abs(left_m) >= 0.1
having nearly_all(count(*) filter (steer * left_m > 0), count(*), 8)
union
select 'controls', 'applied_steer'
from ordered where steers and not drives and abs(turn) >= 0.01
group by action_key, other having nearly_all(count(*) filter (steer * turn > 0), count(*), 3)
union
select 'controls', 'applied_throttle'
from effect where drives and not steers and abs(faster) >= 0.1
having nearly_all(count(*) filter (drive * faster < 0), count(*), 8)
union
select 'controls', 'applied_throttle'
from ordered where drives and not steers and abs(accel) >= 2
group by action_key, other having nearly_all(count(*) filter (drive * accel < 0), count(*), 3)
