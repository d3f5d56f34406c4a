-- subjects: compared_nominal
select c.group_id as group_id, c.rollout_id as rollout_id, 'rollouts' as "table", coalesce(
        case when c.simulator_version is distinct from n.simulator_version then 'simulator_version' end,
        case when c.collector_version is distinct from n.collector_version then 'collector_version' end
    ) as "column"
from examined_pair p join rollouts c using (run) join rollouts n on n.run = p.nominal_run
where "column" is not null
qualify row_number() over (partition by c.group_id order by c.rollout_id) = 1
