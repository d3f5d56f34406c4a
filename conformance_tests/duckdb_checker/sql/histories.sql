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
