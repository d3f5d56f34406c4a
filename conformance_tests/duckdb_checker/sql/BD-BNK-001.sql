-- subjects: branch_group
select distinct group_id
from branch_group, policy p
where not exists (from candidate c where c.group_id = branch_group.group_id and c.action_key = p.key)
