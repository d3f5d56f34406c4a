-- subjects: (select 1 from effect where is_commanded and response is not null group by action_key having count(*) >= 3) + (select 1 from effect where abs(later) >= 2 having count(*) >= 8)
with early as (
    select action_key from effect where is_commanded and response is not null
    group by grouping sets ((), (action_key))
    having nearly_all(count(*) filter (response = 0), count(*), case when grouping(action_key) = 1 then 8 else 3 end)
)
select distinct 'observations' as "table", null as "column" from early
union all
select 'observations', 'accel_longitudinal_mps2'
from effect where abs(later) >= 2 and not exists (from early)
having nearly_all(count(*) filter (sooner * sign(later) >= abs(later) / 2), count(*), 8)
