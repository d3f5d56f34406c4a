-- subjects: (select 1 from attempt semi join evidence using (run) having count(*) >= 8)
select 'evidence' as "table", 'collision' as "column"
from (select run, bool_or(collision) as touches from attempt join evidence using (run) group by run)
having nearly_all(count(*) filter (touches), count(*), 8)
