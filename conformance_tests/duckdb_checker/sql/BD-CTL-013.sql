-- subjects: attempt where role in ('nominal', 'nominal_replay') and run in (select run from control)
select rollout_id, group_id, 'controls' as "table", 'active' as "column", min(tick) as tick
from control where role in ('nominal', 'nominal_replay') and active
group by all
