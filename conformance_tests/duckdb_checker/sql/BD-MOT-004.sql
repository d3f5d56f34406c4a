-- subjects: attempt where t_b is not null
with history as (
    select run, count(*) filter (is_free and f.tick between t_b - 75 and t_b) as num_judged
    from attempt join free f using (run) group by run
), touched as (
    select run, min(tick) as tick from evidence where collision group by run
)
select rollout_id, group_id, 'evidence' as "table", 'collision' as "column", tick
from attempt join touched using (run) join history using (run)
where t_b is not null and (tick = 0 or num_judged < 8)
