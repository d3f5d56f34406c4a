-- subjects: attempt where t_b is not null
select a.rollout_id, a.group_id, 'rollouts' as "table",
    first(case when trigger_tick - t_b > $trigger_delay_ticks then 'trigger_tick' else 'trigger_value' end) as "column"
from attempt a
join controls c on c.tick = a.trigger_tick
    and c.run = case when a.role = 'nominal' then a.run else a.nominal_run end
where trigger_tick - t_b > $trigger_delay_ticks
    or case trigger_signal
        when 'brake' then abs(trigger_value::double - c.expert_brake) > $signal
        when 'throttle_release' then abs(trigger_value::double - c.expert_throttle) > $signal
        when 'steer' then least(abs(trigger_value::double - c.expert_steer),
                                abs(trigger_value::double - abs(c.expert_steer))) > $signal
        else false end
    or case when trigger_signal = 'throttle_release' then trigger_value > trigger_threshold
            else abs(trigger_value) < abs(trigger_threshold) end
group by a.run, a.rollout_id, a.group_id
