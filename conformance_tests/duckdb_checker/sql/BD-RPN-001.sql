-- subjects: replay where $noise = 'exact'
select rollout_id, group_id, first("table" order by tick, "table" desc) as "table",
    first("column" order by tick, "table" desc) as "column", min(tick) as tick
from replayed where differs and $noise = 'exact'
group by rollout_id, group_id
