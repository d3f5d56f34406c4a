-- subjects: compared_nominal
select c.group_id as group_id, c.rollout_id as rollout_id, 'rollouts' as "table", coalesce(
        case when c.scenario_type is distinct from n.scenario_type then 'scenario_type' end,
        case when c.environment is distinct from n.environment then 'environment' end,
        case when c.ego_length_m is distinct from n.ego_length_m then 'ego_length_m' end,
        case when c.ego_width_m is distinct from n.ego_width_m then 'ego_width_m' end,
        case when c.ego_height_m is distinct from n.ego_height_m then 'ego_height_m' end
    ) as "column"
from examined_pair p join rollouts c using (run) join rollouts n on n.run = p.nominal_run
where "column" is not null
qualify row_number() over (partition by c.group_id order by c.rollout_id) = 1
