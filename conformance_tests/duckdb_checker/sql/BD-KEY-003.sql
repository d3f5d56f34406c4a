-- subjects: rollouts
select group_id, 'rollouts' as "table"
from rollouts where group_id is not null group by group_id having count(distinct shard) > 1
