-- subjects: intervened where $noise = 'exact'
select rollout_id, group_id, "table", tick, "column" from unlike_nominal where $noise = 'exact' and run in (select run from intervened)
