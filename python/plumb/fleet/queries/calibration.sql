-- Machines whose calibration is overdue, or is not that of the certificate.
-- Parameter: $today. The log has the check sum of the calibration in force (2062h sub 1) and the
-- hash of its report (2063h), where somebody has read them; when the calibration is due, and the
-- certificate's figures, only the manifest has (calibration_due, certificate_sha256 of dcc.xml,
-- certificate_crc32, one for each node or several in one text).
with newest as (
    select machine, interface, instrument,
        arg_max(a_calibration_crc32, day) filter (a_calibration_crc32 is not null) as a_crc32,
        arg_max(b_calibration_crc32, day) filter (b_calibration_crc32 is not null) as b_crc32,
        arg_max(a_report_sha256, day) filter (a_report_sha256 is not null) as a_sha256,
        arg_max(b_report_sha256, day) filter (b_report_sha256 is not null) as b_sha256
    from figures
    where cast(day as date) <= cast($today as date)
    group by all
),
-- An empty text is no check sum and no hash.
stated as (
    select machine, calibration_due, nullif(trim(certificate_crc32), '') as certificate_crc32,
        nullif(trim(certificate_sha256), '') as certificate_sha256
    from machines
),
judged as (
    select n.*, cast(m.calibration_due as date) as due, m.certificate_crc32, m.certificate_sha256,
        coalesce(cast(m.calibration_due as date) < cast($today as date), false) as overdue,
        coalesce(not contains(upper(m.certificate_crc32), upper(a_crc32)), false)
            or coalesce(not contains(upper(m.certificate_crc32), upper(b_crc32)), false)
            as other_calibration,
        coalesce(lower(m.certificate_sha256) <> a_sha256, false)
            or coalesce(lower(m.certificate_sha256) <> b_sha256, false) as other_report
    from newest n
    join stated m using (machine)
)
select * from judged
where overdue or other_calibration or other_report
order by machine, interface, instrument
