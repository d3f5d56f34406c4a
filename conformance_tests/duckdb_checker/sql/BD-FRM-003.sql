-- subjects: frames
with keyed as (
    select shard, run, rollout_id, tick, camera, row_number() over (partition by run, tick, camera) as copy from frames
)
select shard, rollout_id, tick, camera, 'frames' as "table"
from keyed
where run is not null and (copy > 1 or not exists (
    from observations o where o.run = keyed.run and o.tick = keyed.tick))
