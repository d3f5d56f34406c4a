-- subjects: controls + observations + actors + evidence + frames
select 'controls' as "table", rollout_id, tick, null as actor_id from controls
where run is null and rollout_id is not null
union all select 'observations', rollout_id, tick, null from observations where run is null and rollout_id is not null
union all select 'actors', rollout_id, tick, actor_id from actors where run is null and rollout_id is not null
union all select 'evidence', rollout_id, tick, null from evidence where run is null and rollout_id is not null
union all select 'frames', rollout_id, tick, null from frames where run is null and rollout_id is not null
