-- subjects: frames
with keyed as (
    select shard, rollout_id, tick, row_number() over (partition by shard, rollout_id, tick, camera) as copy from frames
)
select rollout_id, tick, 'frames' as "table"
from keyed semi join rollouts using (shard, rollout_id)
where copy > 1 or not exists (
    from observations o where o.shard = keyed.shard and o.rollout_id = keyed.rollout_id and o.tick = keyed.tick)
