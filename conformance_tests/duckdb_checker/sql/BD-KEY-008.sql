-- subjects: rollouts
select shard, rollout_id, 'rollouts' as "table", 'action_key' as "column"
from rollouts r left join policy p on p.key = r.action_key
where action_key is not null and (p.key is null or case role when 'drive' then not $has_drives
    else (role = 'intervention') = (p.duration_ticks = 0) end)
