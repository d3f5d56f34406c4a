-- subjects: rollouts
with counted as (
    select r.shard, r.rollout_id, num_ticks, num_observations,
        (select count(*) from controls c where c.run = r.run) as ticks,
        (select count(*) from observations o where o.run = r.run) as observations
    from rollouts r
)
select shard, rollout_id, 'rollouts' as "table", 'num_ticks' as "column" from counted where num_ticks <> ticks
union all
select shard, rollout_id, 'rollouts', 'num_observations' from counted where num_observations <> observations
