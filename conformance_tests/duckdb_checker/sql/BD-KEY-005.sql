-- subjects: rollouts where nominal_rollout_id is not null and role is distinct from 'nominal'
select r.shard, r.rollout_id, 'rollouts' as "table", 'nominal_rollout_id' as "column"
from rollouts r
where r.nominal_rollout_id is not null and r.role is distinct from 'nominal' and not exists (
    from rollouts n where n.rollout_id = r.nominal_rollout_id and n.group_id = r.group_id and n.role = 'nominal')
