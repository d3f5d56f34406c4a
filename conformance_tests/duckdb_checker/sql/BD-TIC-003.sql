-- subjects: attempt
select rollout_id, group_id, 'rollouts' as "table", 'branch_tick' as "column"
from attempt where t_b is null or t_b % 5 <> 0 or branch_frame is distinct from t_b // 5
