-- subjects: intervened where $noise = 'exact'
with told_apart as (
    select run, rollout_id, group_id, 1 as place, "table", tick, "column" from unlike_nominal
    where $noise = 'exact' and run in (select run from intervened)
    union all  -- the expert at the branch, which sees what the nominal's sees
    select i.run, i.rollout_id, i.group_id, 2, 'controls', t_b, case when c.expert_steer <> n.expert_steer then 'expert_steer'
        when c.expert_throttle <> n.expert_throttle then 'expert_throttle' else 'expert_brake' end
    from intervened i join controls c on c.run = i.run and c.tick = t_b join controls n on n.run = i.nominal_run and n.tick = t_b
    where $noise = 'exact' and (c.expert_steer, c.expert_throttle, c.expert_brake)
        <> (n.expert_steer, n.expert_throttle, n.expert_brake)
)
select rollout_id, group_id, "table", tick, "column" from told_apart
qualify row_number() over (partition by run order by place) = 1
