-- Temperature and vibration of each machine, day by day.
-- Vibration is the energy above 150 Hz as a multiple of the channel's own noise, out of the
-- activity that the nodes send each other (2010h sub 9): 2^((activity - 64) / 8). Its middle is
-- that of the mean activity.
select
    machine, interface, instrument, date,
    least(a_temperature_degc_min, b_temperature_degc_min) as temperature_min_degc,
    (a_temperature_degc_mean + b_temperature_degc_mean) / 2 as temperature_mean_degc,
    greatest(a_temperature_degc_max, b_temperature_degc_max) as temperature_max_degc,
    pow(2, ((a_activity_mean + b_activity_mean) / 2 - 64) / 8) as vibration_middle,
    pow(2, (greatest(a_activity_max, b_activity_max) - 64) / 8) as vibration_max
from machine_days
where a_temperature_degc_mean is not null or a_activity_mean is not null
order by machine, interface, instrument, date
