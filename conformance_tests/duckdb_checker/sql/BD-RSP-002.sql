-- subjects: effect
select action_key
from effect where is_commanded
group by action_key having nearly_all(count(*) filter (first_difference is null), count(*), 3)
