-- Days without data, from a machine's first day to today.
-- Parameter: $today. A machine is silent for silent_now days at the end.
with spans as (
    select machine, min(date) as first_day, max(date) as last_day,
        count(distinct date) as days
    from machine_days
    where covered_s > 0
    group by machine
)
select machine, first_day, last_day, days,
    date_diff('day', first_day, cast($today as date)) + 1 - days as silent_days,
    date_diff('day', last_day, cast($today as date)) as silent_now
from spans
where date_diff('day', first_day, cast($today as date)) + 1 > days
order by silent_now desc, silent_days desc, machine
