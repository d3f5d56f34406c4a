-- subjects: (select 1 from effect where is_commanded group by action_key having count(*) >= 3)
with alike as (
    select b.action_key, a.action_key as other, a.first_difference is not null and a.future = b.future as is_one
    from effect a join policy p on p.key = a.action_key
    join effect b on b.group_id = a.group_id join policy q on q.key = b.action_key and q.rowid > p.rowid
    where a.moves and (abs(a.steer - b.steer) >= 0.04 or abs(a.drive - b.drive) >= 0.04)
)
select action_key
from effect where is_commanded
group by action_key having nearly_all(count(*) filter (first_difference is null), count(*), 3)
union all
select action_key
from alike group by action_key, other having nearly_all(count(*) filter (is_one), count(*), 3)
union all
-- What others deny, of pairs that are not found already.
select action_key from driving_pair e
where is_one and (action_key, other) not in (
        select (action_key, other) from alike group by action_key, other having nearly_all(count(*) filter (is_one), count(*), 3))
    and exists (from driving_pair t where t.action_key = e.action_key and t.other = e.other and t.is_told
        and t.apart <= e.apart + 1e-6 and t.began <= e.ended)
    and exists (from driving_pair t where t.action_key = e.action_key and t.other = e.other and t.is_told
        and t.apart <= e.apart + 1e-6 and t.began >= e.began)
group by action_key, other having count(*) >= 3
