-- subjects: (from infraction where (lights or departures) and whole or (lights or stops) and has_map)
-- What attempts count, and what their evidence and the map of their town show.
select rollout_id, group_id, 'rollouts' as "table",
    case when departures and whole and off_road <> left_road then 'result_num_off_road_infractions'
        when red > 0 and (no_signal or whole and not lit) then 'result_num_red_light_infractions'
        else 'result_num_stop_sign_infractions' end as "column"
from infraction
where departures and whole and off_road <> left_road or red > 0 and (no_signal or whole and not lit) or stop > 0 and no_sign or is_far
