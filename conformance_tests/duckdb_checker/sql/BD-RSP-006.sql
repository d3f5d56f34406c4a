-- subjects: prevalence where num_compared >= 8
select case when rule like 'BD-ACT-%' then 'actors' when rule like 'BD-MAP-%' then 'evidence'
    when rule = 'BD-RES-001' then 'rollouts' else 'observations' end as "table"
from prevalence where nearly_all(num_broken, num_compared, 8)
