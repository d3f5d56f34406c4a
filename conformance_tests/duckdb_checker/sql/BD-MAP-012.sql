-- subjects: lined
select shard, town, element_id, 'map' as "table", 'lane_id' as "column" from lined where away_m > $stop_line_m
