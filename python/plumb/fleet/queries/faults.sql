-- Warnings and faults per hour with data: by machine, by model and by firmware.
-- Parameter: $today, behind which no day counts.
-- A fault that both channels report counts twice; an incident counts once.
select
    case
        when grouping(machine) = 0 then 'machine'
        when grouping(model) = 0 then 'model'
        else 'firmware'
    end as grouped_by,
    coalesce(machine, model, firmware) as name,
    count(distinct machine_name) as machines,
    sum(covered_s) / 3600 as hours,
    sum(warning_count) as warnings,
    sum(fault_count) as faults,
    sum(incidents) as incidents,
    sum(warning_count) / nullif(sum(covered_s) / 3600, 0) as warnings_per_hour,
    sum(fault_count) / nullif(sum(covered_s) / 3600, 0) as faults_per_hour,
    sum(incidents) / nullif(sum(covered_s) / 3600, 0) as incidents_per_hour
from (select *, machine as machine_name from machine_days where date <= cast($today as date))
group by grouping sets ((machine), (model), (firmware))
order by grouped_by desc, incidents_per_hour desc nulls last, name
