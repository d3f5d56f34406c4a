-- subjects: (select 1 from (select 1 from effect where is_steered having count(*) >= 8 union all select 1 from effect where is_driven having count(*) >= 8))
select 'controls' as "table", 'expert_steer' as "column" from effect where is_steered
having nearly_all(count(*) filter (one_steer), count(*), 8) or nearly_all(count(*) filter (nominal_steer), count(*), 8)
    or nearly_all(count(*) filter (own_steer), count(*), 8)
union all
select 'controls', 'expert_throttle' from effect where is_driven
having nearly_all(count(*) filter (one_pedal), count(*), 8) or nearly_all(count(*) filter (nominal_pedals), count(*), 8)
    or nearly_all(count(*) filter (own_pedals), count(*), 8)
