-- subjects: intervened where $noise = 'exact'
with told_of as (
    select 1 as place, 'observations' as "table", * from told('observations')
    union all select 2, 'evidence', * from told('evidence')
    union all select 3, 'actors', * from told('actors')
    union all select 4, 'controls', * from told('controls')
), history as (
    select run, rollout_id, group_id, place, "table", at_tick, texts, of_run <> run as is_nominal,
        row_number() over (partition by run, of_run, place order by at_tick, texts) as number
    from intervened join told_of on of_run in (run, nominal_run)
    where $noise = 'exact' and at_tick <= t_b - (place = 4)::integer
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
), told_apart as (
    select run, rollout_id, group_id, place, number, "table", case when not is_uneven then tick end as tick, case when not is_uneven
        then names[[i for i in range(1, len(own) + 1) if own[i] is distinct from expected[i]][1]] end as "column"
    from differing join named using ("table")
    union all  -- the expert at the branch, which sees what the nominal's sees
    select i.run, i.rollout_id, i.group_id, 5, 1, 'controls', t_b, case when c.expert_steer <> n.expert_steer then 'expert_steer'
        when c.expert_throttle <> n.expert_throttle then 'expert_throttle' else 'expert_brake' end
    from intervened i join controls c on c.run = i.run and c.tick = t_b join controls n on n.run = i.nominal_run and n.tick = t_b
    where $noise = 'exact' and (c.expert_steer, c.expert_throttle, c.expert_brake)
        <> (n.expert_steer, n.expert_throttle, n.expert_brake)
)
select rollout_id, group_id, "table", tick, "column" from told_apart
qualify row_number() over (partition by run order by place, number) = 1
