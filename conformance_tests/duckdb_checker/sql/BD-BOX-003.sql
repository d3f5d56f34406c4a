-- subjects: attempt
with body as (
    select 'rollouts' as "table", 'ego_width_m' as "column", ego_width_m as width_m from attempt
    union all
    select 'actors', 'width_m', width_m
    from track where actor_class = 'vehicle' and tick = begin_tick
)
select "table", "column" from body
group by "table", "column" having nearly_all(count(*) filter (width_m < $narrow_vehicle_m), count(*), 8)
union all
select "table", "column" from body
group by "table", "column" having nearly_all(count(*) filter (width_m > $wide_vehicle_m), count(*), 8)
