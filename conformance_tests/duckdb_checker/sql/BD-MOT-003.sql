-- subjects: (from attempt semi join (select run from compared where rule = 'BD-MOT-003' union select run from standing) using (run))
select rollout_id, group_id, 'observations' as "table", first("column" order by tick, place) as "column", min(tick) as tick
from (
    select run, tick, "column", if("column" = 'accel_longitudinal_mps2', 1, 2) as place from broken where rule = 'BD-MOT-003'
    union all from standing
) join attempt using (run)
group by rollout_id, group_id
