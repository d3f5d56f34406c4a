-- subjects: examined_group
select distinct group_id
from examined_group, policy p
where not exists (from candidate c where c.group_id = examined_group.group_id and c.action_key = p.key)
