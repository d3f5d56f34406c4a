-- subjects: attempt
select case when rule like 'BD-ACT-%' then 'actors' else 'observations' end as "table"
from failed
where rule in ('BD-MOT-001', 'BD-MOT-002', 'BD-MOT-003', 'BD-RTE-001', 'BD-RTE-002',
               'BD-ACT-001', 'BD-ACT-002', 'BD-ACT-003', 'BD-ACT-004')
group by rule having nearly_all(count(distinct rollout_id), (select count(*) from attempt), 8)
