-- subjects: (select 1 from rollouts having count(*) >= 8) + (select 1 from body_of_vehicle having count(*) >= 8)
with body as (
    select 'rollouts' as "table", 'ego_width_m' as "column", ego_width_m as width_m from rollouts
    union all
    select 'actors', 'width_m', width_m from body_of_vehicle
)
select "table", "column" from body
group by "table", "column" having nearly_all(count(*) filter (width_m < $narrow_vehicle_m), count(*), 8)
union all
select "table", "column" from body
group by "table", "column" having nearly_all(count(*) filter (width_m > $wide_vehicle_m), count(*), 8)
