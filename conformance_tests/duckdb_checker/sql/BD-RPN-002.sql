-- subjects: replay where run in (select run from replayed) and ($noise = 'injected' or $noise = 'natural' and shard in (select shard from replayed group by shard having count(distinct run) > 1))
with copies as (
    select shard, run, rollout_id, group_id, not bool_or(differs) as is_copy from replayed group by all
), counted as (
    select *, count(*) over (partition by shard) as replays, bool_and(is_copy) over (partition by shard) as all_copies
    from copies
)
select rollout_id, group_id, 'observations' as "table"
from counted
where is_copy and ($noise = 'injected' or ($noise = 'natural' and replays >= 2 and all_copies))
