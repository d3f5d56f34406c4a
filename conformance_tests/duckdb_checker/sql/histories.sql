-- Interventions whose rows before the branch are compared with those of their nominal.
create or replace temp table intervened as
select a.run, a.rollout_id, a.group_id, a.nominal_run, a.t_b
from attempt a join rollouts n on n.run = a.nominal_run and n.status = 'complete'
where a.role = 'intervention' and a.t_b is not null
    and (a.run in (select run from observations) or a.nominal_run in (select run from observations));

-- Rows of a table with their values as texts, in the order of the columns: texts tell -0.0 from 0.0 and 1 from its neighbours.
create or replace macro told(name) as table
with texts as (select run as of_run, tick as at_tick, columns(* exclude (shard, run, rollout_id))::varchar from query_table(name))
select of_run, at_tick, list_value(*columns(* exclude (of_run, at_tick))) as texts from texts;

-- Attempts that repeat their nominal up to a tick where replays are exact: interventions the branch, replays the last of both.
create or replace temp table repeated as
with ends as (
    select run, max(tick) as last_tick from observations group by run
)
select run, rollout_id, group_id, nominal_run, t_b as last_tick from intervened
union all
select a.run, a.rollout_id, a.group_id, a.nominal_run, least(own.last_tick, other.last_tick)
from attempt a join ends own on own.run = a.run join ends other on other.run = a.nominal_run
where a.role = 'nominal_replay';

-- The first value of each that its nominal does not have.
create or replace view unlike_nominal as
with told_of as (
    select 1 as place, 'observations' as "table", * from told('observations')
    union all select 2, 'evidence', * from told('evidence')
    union all select 3, 'actors', * from told('actors')
    union all select 4, 'controls', * from told('controls')
), history as (
    select run, rollout_id, group_id, place, "table", at_tick, texts, of_run <> run as is_nominal,
        row_number() over (partition by run, of_run, place order by at_tick, texts) as number
    from repeated join told_of on of_run in (run, nominal_run)
    where at_tick <= last_tick - (place = 4)::integer
), compared as (
    select run, rollout_id, group_id, place, "table", number, any_value(at_tick) as tick,
        any_value(texts) filter (not is_nominal) as own, any_value(texts) filter (is_nominal) as expected
    from history group by all
), differing as (
    select *, bool_or(own is null or expected is null) over (partition by run, place) as is_uneven
    from compared where own is distinct from expected
), named as (
    select table_name as "table", list(column_name order by column_index) as names
    from duckdb_columns() where column_name not in ('shard', 'run', 'rollout_id') group by table_name
)
select run, rollout_id, group_id, "table", case when not is_uneven then tick end as tick, case when not is_uneven
    then names[[i for i in range(1, len(own) + 1) if own[i] is distinct from expected[i]][1]] end as "column"
from differing join named using ("table")
qualify row_number() over (partition by run order by place, number) = 1;

-- How far replays under noise are from their nominal before the branch.
create or replace temp table near_history as
select o.run, o.rollout_id, a.group_id, a.nominal_rollout_id, o.tick, sqrt(pow(o.x_m - n.x_m, 2) + pow(o.y_m - n.y_m, 2)) as away_m,
    abs(o.speed_mps::double - n.speed_mps) as faster_mps
from attempt a join rollouts r on r.run = a.nominal_run and r.status = 'complete'
join observations o on o.run = a.run join observations n on n.run = a.nominal_run and n.tick = o.tick
join free f on f.run = o.run and f.tick = o.tick and f.is_free join free g on g.run = n.run and g.tick = n.tick and g.is_free
where a.role <> 'nominal' and $noise <> 'exact' and o.tick - a.t_b between -80 and 0;

-- Nominals whose motion itself is wrong.
create or replace view unlike as
select rollout_id as nominal_rollout_id from failed where rule in ('BD-MOT-001', 'BD-RTE-001');
