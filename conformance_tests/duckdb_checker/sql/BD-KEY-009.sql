-- subjects: rollouts + decisions
select shard, rollout_id, 'rollouts' as "table", 'role' as "column", null::integer as tick
from rollouts where role not in ('nominal', 'drive')
union all
select d.shard, d.rollout_id, 'decisions', 'tick', d.tick
from decisions d join rollouts r using (run)
where r.role <> 'drive' or not exists (select 1 from observations o where o.run = d.run and o.tick = d.tick)
union all
select shard, rollout_id, 'decisions', 'tick', tick
from decisions where run is not null group by all having count(*) > 1
union all
select d.shard, d.rollout_id, 'decisions', 'action_key', d.tick
from decisions d left join policy p on p.key = d.action_key where d.action_key is not null and p.key is null
union all
select r.shard, r.rollout_id, 'rollouts', 'action_key', null
from rollouts r
left join (select run, min(tick) as tick, arg_min(action_key, tick) as action_key from decisions group by run) f using (run)
where r.role = 'drive' and (f.tick is distinct from r.branch_tick or f.action_key is distinct from r.action_key)
