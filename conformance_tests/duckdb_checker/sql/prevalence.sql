-- In how many attempts a relation is broken, of how many in which it can be compared, whatever contacts there are.
create or replace temp table prevalence as
select rule, count(distinct run) filter (is_broken) as num_broken, count(distinct run) as num_compared
from (select rule, run, is_broken from relation union all select rule, run, is_broken from moved)
group by rule
union all
select rule, count(distinct rollout_id), attempts
from judged left join failed using (rule)
where rule in ('BD-RTE-001', 'BD-RTE-003', 'BD-MAP-005', 'BD-MAP-006', 'BD-RES-001')
group by rule, attempts;
