-- subjects: effect
select 'observations' as "table"
from effect where steers or drives
having nearly_all(count(*) filter (response = 0), count(*), 8)
