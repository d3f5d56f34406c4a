-- subjects: actors + evidence
with keyed as (
    select 'actors' as "table", shard, rollout_id, tick, actor_id, row_number() over (
        partition by shard, rollout_id, tick, actor_id) as copy
    from actors
    union all
    select 'evidence', shard, rollout_id, tick, null, row_number() over (partition by shard, rollout_id, tick)
    from evidence
)
select "table", rollout_id, tick, actor_id
from keyed semi join rollouts using (shard, rollout_id)
where tick is not null and (copy > 1 or not exists (
    from observations o where o.shard = keyed.shard and o.rollout_id = keyed.rollout_id and o.tick = keyed.tick))
