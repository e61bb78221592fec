-- Nodes that have restarted: boot-ups behind other frames of the same node.
-- Parameters: $today, and $recent_days, the days until today that count as recent.
select machine, interface, instrument,
    sum(restart_count) as restarts,
    sum(restart_count) filter (date > cast($today as date) - cast($recent_days as integer))
        as recent_restarts,
    count(*) filter (restart_count > 0) as days_with_restarts,
    max(date) filter (restart_count > 0) as last_restart
from machine_days
where date <= cast($today as date)
group by all
having sum(restart_count) > 0
order by recent_restarts desc nulls last, restarts desc, machine
