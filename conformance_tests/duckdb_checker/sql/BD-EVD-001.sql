-- subjects: attempt where run in (select run from evidence semi join observations using (run, tick))
with bounds as (
    select e.*, a.group_id, min(r.gap) filter (is_near and does_matter) as surely
    from evidence e join attempt a using (run)
    left join relevant r using (run, tick)
    group by all
), judged as (
    select b.rollout_id, b.group_id, b.tick, case when separation_available
        then exists (
            from relevant r
            where r.run = b.run and r.tick = b.tick and may_near and may_matter
                and r.gap <= coalesce(surely, r.gap)
                and abs(separation_m - r.gap) <= $evidence + $evidence * r.gap)
            and exists (
            from relevant r
            where r.run = b.run and r.tick = b.tick and may_near and may_matter
                and r.actor_id = separation_actor_id and abs(separation_m - r.gap) <= $evidence + $evidence * r.gap)
        else surely is null end as agrees
    from bounds b
)
select rollout_id, group_id, 'evidence' as "table", 'separation_m' as "column", min(tick) as tick
from judged where not agrees
group by rollout_id, group_id
