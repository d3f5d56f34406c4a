-- subjects: controls + observations + actors + evidence + frames
select "table", rollout_id, tick, actor_id
from (
    select 'controls' as "table", shard, rollout_id, tick, null as actor_id from controls
    union all select 'observations', shard, rollout_id, tick, null from observations
    union all select 'actors', shard, rollout_id, tick, actor_id from actors
    union all select 'evidence', shard, rollout_id, tick, null from evidence
    union all select 'frames', shard, rollout_id, tick, null from frames
) as rows_of_tables
anti join rollouts using (shard, rollout_id)
where rollout_id is not null
