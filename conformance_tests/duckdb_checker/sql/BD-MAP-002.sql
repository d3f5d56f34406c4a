-- subjects: map
select shard, town, element_id, 'map' as "table", 'element_id' as "column"
from map group by shard, town, element_id having count(*) > 1
