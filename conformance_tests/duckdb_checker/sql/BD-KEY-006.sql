-- subjects: actors + evidence
with keyed as (
    select shard, 'actors' as "table", run, rollout_id, tick, actor_id, row_number() over (
        partition by run, tick, actor_id) as copy
    from actors
    union all
    select shard, 'evidence', run, rollout_id, tick, null, row_number() over (partition by run, tick) from evidence
)
select shard, "table", rollout_id, tick, actor_id
from keyed left join (select run, tick, true as saved from observations group by all) using (run, tick)
where run is not null and tick is not null and (copy > 1 or saved is null)
