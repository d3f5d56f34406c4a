-- subjects: map
select town, 'map' as "table"
from (
    select shard, town, list(element order by element) as elements
    from (select shard, town, (map_row)::varchar as element
          from (select shard, town, row(columns(* exclude (shard, town))) as map_row from map))
    group by shard, town
)
group by town having count(distinct elements) > 1
