-- subjects: evidence
select shard, rollout_id, tick, 'evidence' as "table", 'ttc_s' as "column"
from evidence where isfinite(ttc_s) and ttc_s > 500
