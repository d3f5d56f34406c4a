-- subjects: (select 1 from effect where steers and not drives and abs(left_m) >= 0.1 having count(*) >= 8) + (select 1 from effect where drives and not steers and abs(faster) >= 0.1 having count(*) >= 8)
select 'controls' as "table", 'applied_steer' as "column"
from effect where steers and not drives and abs(left_m) >= 0.1
having nearly_all(count(*) filter (steer * left_m > 0), count(*), 8)
union all
select 'controls', 'applied_throttle'
from effect where drives and not steers and abs(faster) >= 0.1
having nearly_all(count(*) filter (drive * faster < 0), count(*), 8)
