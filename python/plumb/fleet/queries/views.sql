-- What the other queries ask: the figures of each machine's day, with its model and its firmware.
-- Tables: figures and machines (docs/fleet.md).
-- The model is the manifest's, else the product code (1018h sub 2); the firmware the manifest's,
-- else the software's version (100Ah), else the revision (1018h sub 3), as last read until then.
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
    ) as firmware
from figures f
left join machines m using (machine)
window known as (partition by f.machine, f.interface, f.instrument order by f.day)
