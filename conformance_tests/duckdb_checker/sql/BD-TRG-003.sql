-- subjects: attempt where t_b is not null
select a.rollout_id, a.group_id, 'rollouts' as "table",
    first(case when trigger_tick - t_b > case trigger_signal when 'steady' then 0 else $trigger_delay_ticks end
          then 'trigger_tick' else 'trigger_value' end) as "column"
from attempt a
join controls c on c.tick = a.trigger_tick
    and c.run = case when a.role = 'nominal' then a.run else a.nominal_run end
where trigger_tick - t_b > case trigger_signal when 'steady' then 0 else $trigger_delay_ticks end
    or case trigger_signal
        when 'brake' then abs(trigger_value::double - c.expert_brake) > $signal
        when 'throttle_release' then abs(trigger_value::double - c.expert_throttle) > $signal
        when 'steer' then least(abs(trigger_value::double - c.expert_steer),
                                abs(trigger_value::double - abs(c.expert_steer))) > $signal
        when 'steady' then abs(trigger_value::double - (
            select max(greatest(abs(l.expert_steer::double - c.expert_steer),
                                abs(l.expert_throttle::double - c.expert_throttle),
                                abs(l.expert_brake::double - c.expert_brake)))
            from controls l where l.run = c.run and l.tick between c.tick and c.tick + 49)) > $signal
        else false end
    or case when trigger_signal in ('throttle_release', 'steady') then trigger_value > trigger_threshold
            else abs(trigger_value) < abs(trigger_threshold) end
group by a.run, a.rollout_id, a.group_id
