-- subjects: frames
with keyed as (
    select run, rollout_id, tick, row_number() over (partition by run, tick, camera) as copy from frames
)
select rollout_id, tick, 'frames' as "table"
from keyed
where run is not null and (copy > 1 or not exists (
    from observations o where o.run = keyed.run and o.tick = keyed.tick))
