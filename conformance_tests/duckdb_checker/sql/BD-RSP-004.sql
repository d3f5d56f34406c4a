-- subjects: (select 1 from effect where is_commanded and response is not null having count(*) >= 8)
select 'observations' as "table"
from effect where is_commanded and response is not null
having nearly_all(count(*) filter (response > 5), count(*), 8)
