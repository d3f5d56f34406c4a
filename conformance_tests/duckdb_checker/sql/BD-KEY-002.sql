-- subjects: rollouts
select shard, rollout_id, 'rollouts' as "table", 'attempt' as "column"
from rollouts
qualify count(*) over (partition by shard, group_id, role, action_key, protocol_variant, attempt) > 1
