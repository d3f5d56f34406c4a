-- subjects: compared_nominal
select c.group_id as group_id, c.rollout_id as rollout_id, 'rollouts' as "table", coalesce(
        case when c.town is distinct from n.town then 'town' end
    ) as "column"
from examined_pair p join rollouts c using (run) join rollouts n on n.run = p.nominal_run
where "column" is not null
qualify row_number() over (partition by c.group_id order by c.rollout_id) = 1
