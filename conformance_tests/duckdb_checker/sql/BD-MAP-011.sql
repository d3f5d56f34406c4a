-- subjects: (select distinct shard, town, element_id from meeting)
-- Lanes that meet another head-on, and none that goes on in them.
select shard, town, element_id, 'map' as "table", 'x_m' as "column"
from (
    select shard, town, element_id, is_last from meeting group by all having bool_or(is_contrary) and not bool_or(goes_on)
)
group by shard, town, element_id
