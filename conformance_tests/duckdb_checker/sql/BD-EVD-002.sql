-- subjects: attempt where run in (select run from evidence semi join observations using (run, tick))
with bounds as (
    select e.*, a.group_id, min(r.ttc) filter (is_near and does_matter and does_close) as surely
    from evidence e join attempt a using (run)
    left join relevant r using (run, tick)
    group by all
), judged as (
    select b.rollout_id, b.group_id, b.tick, case when ttc_available
        then exists (
            from relevant r
            where r.run = b.run and r.tick = b.tick and may_near and may_matter
                and r.ttc <= coalesce(surely, r.ttc) and abs(ttc_s - r.ttc) <= $evidence + $evidence * r.ttc)
            and exists (
            from relevant r
            where r.run = b.run and r.tick = b.tick and may_near and may_matter
                and r.actor_id = ttc_actor_id and abs(ttc_s - r.ttc) <= $evidence + $evidence * r.ttc)
        else surely is null end as agrees
    from bounds b
)
select rollout_id, group_id, 'evidence' as "table", 'ttc_s' as "column", min(tick) as tick
from judged where not agrees
group by rollout_id, group_id
