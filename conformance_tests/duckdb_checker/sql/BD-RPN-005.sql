-- subjects: attempt where run in (select run from near_history anti join unlike using (nominal_rollout_id))
select rollout_id, group_id, 'observations' as "table", 'x_m' as "column", min(tick) as tick
from near_history anti join unlike using (nominal_rollout_id)
where away_m > $history_m or faster_mps > $history_mps
group by rollout_id, group_id
