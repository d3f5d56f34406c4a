-- subjects: effect
with alike as (
    select greatest(a.action_key, b.action_key) as action_key, least(a.action_key, b.action_key) as other,
        a.first_difference is not null and a.future = b.future as is_one
    from effect a join effect b on a.group_id = b.group_id and a.action_key < b.action_key
    where a.moves and (abs(a.steer - b.steer) >= 0.04 or abs(a.drive - b.drive) >= 0.04)
)
select action_key
from effect where is_commanded
group by action_key having nearly_all(count(*) filter (first_difference is null), count(*), 3)
union all
select action_key
from alike group by action_key, other having nearly_all(count(*) filter (is_one), count(*), 3)
