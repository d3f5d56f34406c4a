-- subjects: attempt where run in (select run from evidence)
select rollout_id, group_id, 'actors' as "table", min(tick) as tick
from (
    select e.rollout_id, a.group_id, e.tick, e.num_actors, count(c.actor_id) as recorded
    from evidence e join attempt a using (run)
    left join actors c using (run, tick)
    group by e.run, e.rollout_id, a.group_id, e.tick, e.num_actors
)
where num_actors <> recorded
group by rollout_id, group_id
