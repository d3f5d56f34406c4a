-- subjects: attempt where run in (select run from control)
select rollout_id, group_id, 'controls' as "table", 'source' as "column", min(tick) as tick
from control where (source = 'intervention') <> active
group by all
