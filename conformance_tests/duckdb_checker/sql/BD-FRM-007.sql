-- subjects: frames
with numbered as (
    select *, row_number() over () as place from frames
),
kept as (
    select run, rollout_id, tick, encoding, first_value(encoding) over (
        partition by run, camera order by tick, place
    ) as as_before
    from numbered where run is not null
)
select rollout_id, tick, 'frames' as "table", 'encoding' as "column"
from kept where encoding <> as_before
