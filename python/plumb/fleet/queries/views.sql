-- What the other queries ask: the figures of each machine's day, with its model and its firmware,
-- and with temperature and vibration of both channels together.
-- Tables: figures and machines (docs/fleet.md).
-- The model is the manifest's, else the product code (1018h sub 2); the firmware the manifest's,
-- else the software's version (100Ah), else the revision (1018h sub 3), as last read until then.
-- Vibration is the energy above 150 Hz as a multiple of the channel's own noise, out of the
-- activity that the nodes send each other (2010h sub 9): 2^((activity - 64) / 8). Its middle is
-- that of the mean activity.
create or replace temp view machine_days as
select
    f.*,
    cast(f.day as date) as date,
    coalesce(
        m.model,
        format('product {:08X}h', last_value(f.a_product_code ignore nulls) over known),
        'unknown'
    ) as model,
    coalesce(
        m.firmware,
        last_value(f.a_software ignore nulls) over known,
        format('revision {:08X}h', last_value(f.a_revision ignore nulls) over known),
        'unknown'
    ) as firmware,
    least(f.a_temperature_degc_min, f.b_temperature_degc_min) as temperature_min_degc,
    (f.a_temperature_degc_mean + f.b_temperature_degc_mean) / 2 as temperature_mean_degc,
    greatest(f.a_temperature_degc_max, f.b_temperature_degc_max) as temperature_max_degc,
    pow(2, ((f.a_activity_mean + f.b_activity_mean) / 2 - 64) / 8) as vibration_middle,
    pow(2, (greatest(f.a_activity_max, f.b_activity_max) - 64) / 8) as vibration_max
from figures f
left join machines m using (machine)
window known as (partition by f.machine, f.interface, f.instrument order by f.day)
