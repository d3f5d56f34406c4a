-- subjects: replay where $noise = 'exact' and run in (select run from replayed)
select rollout_id, group_id, "table", "column", tick
from replayed where differs and $noise = 'exact'
qualify row_number() over (partition by run order by place, tick) = 1
