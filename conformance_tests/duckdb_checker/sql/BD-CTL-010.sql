-- subjects: attempt where role = 'intervention' and run in (select run from control where active)
select c.rollout_id, c.group_id, 'controls' as "table", min(c.tick) as tick
from control c
left join controls n on n.run = c.nominal_run and n.tick = c.tick
where c.active and c.role = 'intervention' and (
    n.applied_steer is distinct from c.nominal_steer or n.applied_throttle is distinct from c.nominal_throttle
    or n.applied_brake is distinct from c.nominal_brake)
group by all
