-- Machines with faults of late: those that stood at the end of the last day, and those of the days
-- before.
-- Parameters: $today, and $recent_days, the days until today that count as recent.
select machine, interface, instrument,
    max(date) as last_day,
    arg_max_null(standing, date) as standing,
    arg_max_null(standing_text, date) as standing_text,
    count(*) filter (fault_count > 0) as days_with_faults,
    sum(fault_count) as faults
from machine_days
where date > cast($today as date) - cast($recent_days as integer)
    and date <= cast($today as date)
group by all
having sum(fault_count) > 0 or arg_max_null(standing, date) > 0
order by standing desc, days_with_faults desc, machine
