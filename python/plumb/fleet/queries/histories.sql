-- Parameter: $today, behind which no day counts.
-- Temperature and vibration of each machine, day by day; views.sql has what vibration is.
select
    machine, interface, instrument, date,
    temperature_min_degc, temperature_mean_degc, temperature_max_degc,
    vibration_middle, vibration_max
from machine_days
where date <= cast($today as date)
    and (a_temperature_degc_mean is not null or a_activity_mean is not null)
order by machine, interface, instrument, date
