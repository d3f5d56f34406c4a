-- subjects: rollouts
select shard, rollout_id, 'rollouts' as "table", 'town' as "column"
from rollouts r
where not exists (from map m where m.shard = r.shard and m.town = r.town and m.kind = 'lane')
