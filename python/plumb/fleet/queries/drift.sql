-- The drift of A - B: a line through the daily means, with its standard error, and the day on
-- which it leaves the band.
-- Parameters: $today, behind which no day counts; $band_deg, half the width of the band, null for the expanded uncertainty of the
-- difference (k = 2) out of the standard uncertainties that the nodes have sent; $least_days,
-- days that a line needs.
-- A drift is significant where chance gives such a one in fewer than about one of 10 000 lines, by
-- Student's t with days - 2 degrees of freedom (the first terms of its expansion about the normal
-- quantile 3.89). leaves_on is null where it is not significant, and where it goes towards zero; the
-- earliest and the latest day are those of two standard errors.
with axes as (
    select machine, interface, instrument, date, 'x' as axis, difference_x_count as syncs,
        difference_x_mean as mean, a_uncertainty_deg_mean as a_u, b_uncertainty_deg_mean as b_u
    from machine_days
    union all
    select machine, interface, instrument, date, 'y', difference_y_count, difference_y_mean,
        a_uncertainty_deg_mean, b_uncertainty_deg_mean
    from machine_days
),
points as (
    select *, date_diff('day', date '2000-01-01', date) as t from axes
    where syncs > 0 and date <= cast($today as date)
),
sums as (
    select machine, interface, instrument, axis,
        count(*) as days, min(date) as first_day, max(date) as last_day, max(t) as last_t,
        regr_slope(mean, t) as slope, regr_intercept(mean, t) as at_0,
        regr_sxx(mean, t) as sxx, regr_syy(mean, t) as syy, arg_max(mean, t) as newest_deg,
        coalesce(cast($band_deg as double), 2 * sqrt(avg(a_u * a_u) + avg(b_u * b_u))) as band_deg
    from points
    group by all
    having count(*) >= greatest($least_days, 3)
),
lines as (
    select *, at_0 + slope * last_t as level_deg,
        sqrt(greatest(syy - slope * slope * sxx, 1e-12) / (days - 2) / sxx) as error
    from sums
),
judged as (
    select *,
        abs(slope) > error * (3.89 + 15.69 / (days - 2) + 56.3 / ((days - 2) * (days - 2)))
            as significant,
        abs(level_deg) > band_deg as outside,
        sign(slope) * band_deg - level_deg as way
    from lines
),
known as (
    select *, significant and not outside and band_deg is not null and slope <> 0 as leaves
    from judged
)
select machine, interface, instrument, axis, days, first_day, last_day, newest_deg, level_deg,
    slope as deg_per_day, error as deg_per_day_error, 365.25 * slope as deg_per_year,
    365.25 * error as deg_per_year_error, band_deg, significant, outside,
    case when leaves and way / slope < 36500
        then last_day + cast(ceil(way / slope) as integer) end as leaves_on,
    case when leaves and way / slope < 36500
        then last_day + cast(ceil(way / (slope + sign(slope) * 2 * error)) as integer)
        end as leaves_earliest,
    case when leaves and way / (slope - sign(slope) * 2 * error) < 36500
        then last_day + cast(ceil(way / (slope - sign(slope) * 2 * error)) as integer)
        end as leaves_latest
from known
order by outside desc, leaves_on nulls last, abs(slope) desc, machine, interface, instrument, axis
