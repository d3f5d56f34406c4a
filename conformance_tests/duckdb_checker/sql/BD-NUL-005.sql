-- subjects: evidence where ttc_s is not null
select shard, rollout_id, tick, 'evidence' as "table", 'ttc_s' as "column"
from evidence where isfinite(ttc_s) and ttc_s > 500
