-- subjects: (select distinct group_id from effect semi join examined_nominal using (group_id) where moves)
with candidate as (
    select group_id, steer, drive, future, moves from effect
    union all
    select distinct group_id, 0, 0, nominal_future, moves from effect
)
select distinct group_id, 'observations' as "table"
from candidate semi join examined_nominal using (group_id)
where moves group by group_id, future
having max(steer) - min(steer) >= 0.04 or (max(drive) - min(drive) >= 0.2 and min(drive) <= -0.2)
