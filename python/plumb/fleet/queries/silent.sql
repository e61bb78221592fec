-- Days without data, from a machine's first day to today.
-- Parameter: $today. A machine is silent for silent_now days at the end; it has no last_day where
-- its logs have never had a frame of its instruments.
with spans as (
    select machine, min(date) as first_day, max(date) filter (covered_s > 0) as last_day,
        count(distinct date) filter (covered_s > 0) as days
    from machine_days
    where date <= cast($today as date)
    group by machine
)
select machine, first_day, last_day, days,
    date_diff('day', first_day, cast($today as date)) + 1 - days as silent_days,
    date_diff('day', coalesce(last_day, first_day - 1), cast($today as date)) as silent_now
from spans
where date_diff('day', first_day, cast($today as date)) + 1 > days
order by silent_now desc, silent_days desc, machine
