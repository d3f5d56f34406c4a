-- subjects: (select 1 from judged where rule in ('BD-MOT-001', 'BD-MOT-002', 'BD-MOT-003', 'BD-ACT-004', 'BD-RTE-001', 'BD-RTE-003') and attempts >= 8)
select case when rule like 'BD-ACT-%' then 'actors' else 'observations' end as "table"
from failed join judged using (rule)
where rule in ('BD-MOT-001', 'BD-MOT-002', 'BD-MOT-003', 'BD-ACT-004', 'BD-RTE-001', 'BD-RTE-003')
group by rule, judged.attempts having nearly_all(count(distinct rollout_id), judged.attempts, 8)
