-- subjects: attempt where t_b is not null
select rollout_id, group_id, 'rollouts' as "table", 'trigger_rollout_id' as "column"
from attempt
where t_b is not null
    and trigger_rollout_id is distinct from case when role = 'nominal' then rollout_id else nominal_rollout_id end
