-- subjects: attempt where run in (select run from evidence) and (shard, town) not in (select (shard, town) from map where kind = 'signal')
select e.rollout_id, a.group_id, 'evidence' as "table", 'traffic_light' as "column", min(e.tick) as tick
from evidence e join attempt a using (run)
where e.traffic_light_available
    and not exists (from map m where m.shard = a.shard and m.town = a.town and m.kind = 'signal')
group by e.rollout_id, a.group_id
