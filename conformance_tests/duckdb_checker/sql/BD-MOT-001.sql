-- subjects: (from attempt semi join (from compared where rule = 'BD-MOT-001') using (run))
select rollout_id, group_id, 'observations' as "table", first("column") as "column", min(tick) as tick
from broken join attempt using (run) where rule = 'BD-MOT-001'
group by rollout_id, group_id
