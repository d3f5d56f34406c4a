-- subjects: frames
with numbered as (
    select *, row_number() over () as place from frames
),
kept as (
    select shard, run, rollout_id, tick, camera, encoding, first_value(encoding) over (
        partition by run, camera order by tick, place
    ) as as_before
    from numbered where run is not null
)
select shard, rollout_id, tick, camera, 'frames' as "table", 'encoding' as "column"
from kept where encoding <> as_before
