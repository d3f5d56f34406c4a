-- subjects: replay where $noise = 'exact' and run in (select run from replayed)
select rollout_id, group_id, "table", tick, "column" from unlike_nominal where $noise = 'exact' and run in (select run from replay)
