-- subjects: passed
select rollout_id, group_id, 'rollouts' as "table", 'result_num_red_light_infractions' as "column" from passed where is_wrong
