-- subjects: attempt where role <> 'intervention'
select rollout_id, group_id, 'controls' as "table", 'active' as "column", min(tick) as tick
from control where role <> 'intervention' and active
group by all
