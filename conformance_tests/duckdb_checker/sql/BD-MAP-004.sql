-- subjects: (select town from map group by town having count(distinct shard) > 1)
with element as (
    select shard, town, row(element_id, kind, lane_id, x_m, y_m, z_m, width_m, speed_limit_mps, marking)::varchar as text
    from map
), town_map as (
    select shard, town, list(text order by text) as elements from element group by shard, town
)
select town, 'map' as "table" from town_map group by town having count(distinct elements) > 1
