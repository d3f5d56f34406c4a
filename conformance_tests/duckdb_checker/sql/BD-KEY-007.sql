-- subjects: rollouts
with counted as (
    select r.rollout_id, r.group_id, num_ticks, num_observations,
        (select count(*) from controls c where c.shard = r.shard and c.rollout_id = r.rollout_id) as ticks,
        (select count(*) from observations o where o.shard = r.shard and o.rollout_id = r.rollout_id) as observations
    from rollouts r
)
select rollout_id, group_id, 'rollouts' as "table", 'num_ticks' as "column" from counted where num_ticks <> ticks
union all
select rollout_id, group_id, 'rollouts', 'num_observations' from counted where num_observations <> observations
