-- subjects: controls + observations + actors + evidence + frames
with orphan as (
    select shard, 'controls' as "table", rollout_id, tick, null as actor_id, null as camera from controls
    where run is null
    union all
    select shard, 'observations' as "table", rollout_id, tick, null, null from observations where run is null
    union all
    select shard, 'actors' as "table", rollout_id, tick, actor_id, null from actors where run is null
    union all
    select shard, 'evidence' as "table", rollout_id, tick, null, null from evidence where run is null
    union all
    select shard, 'frames' as "table", rollout_id, tick, null, camera from frames where run is null
)
select shard, "table", 'rollout_id' as "column", rollout_id, tick, actor_id, camera from orphan
where rollout_id is not null
