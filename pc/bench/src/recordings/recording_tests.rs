//! Recordings as they come: every fault that can be skipped, and every one that can't.

use std::fmt::Write as _;
use std::io::{Cursor, Write as _};

use flate2::{Compression, write::GzEncoder};

use super::*;
use crate::recordings::columns::AccelUnit;
use crate::recordings::scale::Source;

const HEADER: &str = "time_s,ax_g,ay_g,az_g\n";

fn rows(count: usize) -> String {
    rows_scaled(count, 1.0)
}

fn rows_scaled(count: usize, per_g: f64) -> String {
    let mut text = String::new();
    for i in 0..count {
        let wobble = 0.001 * ((i * 7 % 5) as f64 - 2.0);
        let (t, x, z) = (i as f64 * 0.01, (0.6 + wobble) * per_g, 0.8 * per_g);
        writeln!(text, "{t:.3},{x:.4},0.0001,{z:.4}").unwrap();
    }
    text
}

fn read(text: impl AsRef<[u8]>) -> Result<Recording, FileError> {
    Recording::read(
        "a.csv",
        Cursor::new(text.as_ref().to_vec()),
        Options::default(),
    )
}

fn refusal(text: impl AsRef<[u8]>) -> String {
    let text = read(text).unwrap_err().to_string();
    assert!(text.starts_with("a.csv"), "{text}");
    assert!(!text.contains('\n'), "{text}");
    text
}

fn gzip(text: &str) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(text.as_bytes()).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn a_clean_recording() {
    let recording = read(format!("{HEADER}{}", rows(100))).unwrap();
    assert_eq!((recording.rows.len(), recording.data_lines), (100, 100));
    assert_eq!((recording.period_us, recording.gaps.rows), (10_000, 0));
    assert_eq!(recording.skips.total(), 0);
    assert!((recording.rate_hz() - 100.0).abs() < 1e-9);
    assert!((recording.duration_s() - 0.99).abs() < 1e-9);
    assert_eq!(recording.full_scale(), FullScale::G2);
    let row = recording.rows[2];
    assert_eq!((row.line, row.time_us, row.starts_anew), (4, 20_000, false));
    assert!(recording.rows[0].starts_anew);
    let Counts([x, _, z]) = row.counts(FullScale::G2);
    assert_eq!((x, z), ((row.accel_g[0] * 16384.0).round() as i16, 13_107));
}

#[test]
fn mark_of_byte_order_crlf_comments_spaces_and_quotes() {
    let body = rows(60).replace(',', " , ").replace('\n', "\r\n");
    let text =
        format!("\u{feff}# logger 7\r\n\r\n\"time_s\", AX_G ,ay_g,az_g\r\n# begin\r\n{body}");
    let recording = read(text).unwrap();
    assert_eq!(recording.rows.len(), 60);
    assert_eq!(recording.rows[0].line, 5);
}

#[test]
fn rows_that_can_be_skipped_are_counted_with_their_first_line() {
    let mut text = format!("{HEADER}0,0,0,0\n{}", rows(60));
    text += "0.59,1,0,0\n0.4,1,0,0\n0.7,,0,1\n0.71,x,0,1\n0.72,nan,0,1\n0.73,1,0\n0.74,1,0,0,0\n";
    text += "0.75,17,0,0\n0.76,1,0,inf\n9.9,0,0,1\n0.77,0,0,1\n0.78,0,0,1\n";
    let recording = read(&text).unwrap();
    let expected = [
        (Reason::AllZero, 1, 2),
        (Reason::RepeatedTime, 1, 63),
        (Reason::BackwardTime, 1, 64),
        (Reason::MissingCell, 1, 65),
        (Reason::UnparsableCell, 1, 66),
        (Reason::NotFinite, 2, 67),
        (Reason::CellCount, 2, 68),
        (Reason::OverRange, 1, 70),
        (Reason::ForwardJump, 1, 72),
    ];
    for (reason, rows, first_line) in expected {
        assert_eq!(
            recording.skips.of(reason),
            Count { rows, first_line },
            "{reason}"
        );
    }
    assert_eq!(
        recording.rows.len() as u64 + recording.skips.total(),
        recording.data_lines
    );
    assert_eq!((recording.rows.len(), recording.skips.total()), (62, 11));
}

#[test]
fn one_wrong_time_does_not_take_the_rest_along() {
    let text = format!("{HEADER}{}", rows(200)).replace("\n0.250,", "\n90.250,");
    let recording = read(text).unwrap();
    assert_eq!(recording.rows.len(), 199);
    assert_eq!(
        recording.skips.of(Reason::ForwardJump),
        Count {
            rows: 1,
            first_line: 27
        }
    );
    let first_is_wrong = format!("{HEADER}777,1,0,0\n{}", rows(60));
    assert_eq!(read(first_is_wrong).unwrap().rows.len(), 60);
}

#[test]
fn one_wild_value_does_not_upset_the_unit_check() {
    let text = format!("{HEADER}{}", rows(200)).replace("\n0.500,0.", "\n0.500,8e250.");
    let text = text
        .replace("8e250.", "8e250,")
        .replacen(",0.0001,", ",", 0);
    let recording = read(&text).unwrap();
    assert_eq!(recording.skips.total(), 1);
    let text = format!("{HEADER}{}0.1e1,1e300,-1e300,1\n", rows(60));
    assert_eq!(read(text).unwrap().skips.of(Reason::OverRange).rows, 1);
}

#[test]
fn units_of_time_and_acceleration() {
    let mps2 = rows_scaled(60, 9.80665);
    let recording = read(format!("time_s,ax_mps2,ay_mps2,az_mps2\n{mps2}")).unwrap();
    assert!((recording.rows[0].accel_g[2] - 0.8).abs() < 1e-4);
    assert_eq!(recording.columns.unit, AccelUnit::MetrePerSecond2);

    let lsb = rows_scaled(60, 2048.0);
    let recording = read(format!("time_s,ax_lsb,ay_lsb,az_lsb\n{lsb}")).unwrap();
    assert_eq!(
        (recording.scale.per_g, recording.scale.source),
        (2048.0, Source::Nearest)
    );
    let options = Options {
        lsb_per_g: Some(2000.0),
    };
    let text = format!("time_s,ax_lsb,ay_lsb,az_lsb\n{lsb}");
    let given = Recording::read("a", Cursor::new(text), options).unwrap();
    assert_eq!(
        (given.scale.per_g, given.scale.source),
        (2000.0, Source::Given)
    );

    let in_ms = format!("time_ms,ax_g,ay_g,az_g\n{}", rows(60));
    let text = refusal(&in_ms);
    assert!(
        text.contains("line 1") && text.contains("as if it were `time_s`"),
        "{text}"
    );
    let slow = rows(60)
        .replace("0.", "0")
        .lines()
        .fold(String::new(), |text, line| text + line + "\n");
    assert!(refusal(format!("{HEADER}{slow}")).contains("samples per second is outside"));
}

#[test]
fn wrong_units_are_refused_with_the_one_that_fits() {
    let text = refusal(format!("{HEADER}{}", rows_scaled(60, 9.80665)));
    assert!(
        text.contains("line 1") && text.contains("name the columns `_mps2`"),
        "{text}"
    );
    let text = refusal(format!("{HEADER}{}", rows_scaled(60, 2048.0)));
    assert!(text.contains("name the columns `_lsb`"), "{text}");
    let header = "time_s,ax_lsb,ay_lsb,az_lsb\n";
    let text = refusal(format!("{header}{}", rows_scaled(60, 1400.0)));
    assert!(text.contains("use --lsb-per-g"), "{text}");
}

#[test]
fn files_that_are_no_recording() {
    assert!(refusal("").contains("holds no line"));
    assert!(refusal("\n\n# nothing\n").contains("holds no line"));
    assert!(refusal(gzip("")).contains("holds no line"));
    assert!(refusal(b"\x7fELF\x02\x01\x00\x00").contains("is no text"));
    assert!(refusal([0xff; 200]).contains("is no text"));
    assert!(refusal([0; 200_000]).contains("is no text"));
    assert!(refusal("x".repeat(100_000)).contains("is over 65536 bytes long"));
    assert!(refusal(rows(60)).contains("line 1: holds numbers"));
    assert!(refusal("a,b,c\n1,2,3\n").contains("there is `a`, `b`, `c`"));
    assert!(refusal(format!("{HEADER}{}", rows(49))).contains("only 49 usable rows"));
    assert!(refusal(HEADER).contains("only 0 usable rows"));
    let long = format!("{HEADER}{}{}", rows(60), "7".repeat(70_000));
    assert!(refusal(long).contains("line 62: is over"));
}

#[test]
fn half_the_rows_may_go_and_no_more() {
    let bad = |count: usize| "0.5,,,\n".repeat(count);
    assert!(read(format!("{HEADER}{}{}", rows(60), bad(60))).is_ok());
    let text = refusal(format!("{HEADER}{}{}", rows(60), bad(61)));
    let expected = "line 62: more rows skipped than the 60 kept (61 rows skipped: 61 missing cell";
    assert!(text.contains(expected), "{text}");
}

#[test]
fn a_cut_gzip_names_the_good_rows() {
    let whole = gzip(&format!("{HEADER}{}", rows(3000)));
    assert_eq!(read(&whole).unwrap().rows.len(), 3000);
    let text = refusal(&whole[..whole.len() / 2]);
    let rows: usize = text
        .split("breaks off after ")
        .nth(1)
        .unwrap()
        .split(' ')
        .next()
        .unwrap()
        .parse()
        .unwrap();
    assert!((500..2500).contains(&rows), "{text}");
    let mut damaged = whole.clone();
    let crc = damaged.len() - 6;
    damaged[crc] ^= 0x55;
    assert!(refusal(&damaged).contains("the gzip stream is damaged after"));
}

#[test]
fn gaps_are_counted_and_restart_the_chain() {
    let later = rows(60).replace("\n0.", "\n1.");
    let later = later
        .trim_start_matches("0.000")
        .trim_start_matches(|c| c != '\n');
    let recording = read(format!("{HEADER}{}{}", rows(60), later.trim_start())).unwrap();
    assert_eq!(
        recording.gaps,
        Count {
            rows: 1,
            first_line: 62
        }
    );
    let anew: Vec<u64> = recording
        .rows
        .iter()
        .filter(|row| row.starts_anew)
        .map(|row| row.line)
        .collect();
    assert_eq!(anew, [2, 62]);
}

#[test]
fn extras_that_can_not_be_read_cost_only_themselves() {
    let mut text = "time_s,ax_g,ay_g,az_g,temp_c,ref_qw,ref_qx,ref_qy,ref_qz\n".to_owned();
    for (i, line) in rows(60).lines().enumerate() {
        let extra = match i {
            3 => "warm,1,0,0,0",
            4 => "25,0,0,0,0",
            5 => "25,1,0,0,",
            6 => ",,,,",
            _ => "25.5,-1,0,0,0",
        };
        writeln!(text, "{line},{extra}").unwrap();
    }
    let recording = read(text).unwrap();
    assert_eq!(recording.rows.len(), 60);
    assert_eq!(
        recording.unread_extras,
        Count {
            rows: 3,
            first_line: 5
        }
    );
    assert_eq!(recording.rows[7].temperature_c, Some(25.5));
    assert_eq!(
        recording.rows[7].reference.unwrap().up(),
        Some([0.0, 0.0, 1.0])
    );
    assert_eq!(
        (recording.rows[6].temperature_c, recording.rows[6].reference),
        (None, None)
    );
    assert!(recording.has_reference());
}

#[test]
fn a_wrong_last_time_and_three_in_a_row_are_ahead_of_the_others() {
    let jumps = |text: &str| {
        let recording = read(text).unwrap();
        assert!(recording.duration_s() < 3.0);
        (
            recording.rows.len(),
            recording.skips.of(Reason::ForwardJump),
        )
    };
    let good = format!("{HEADER}{}", rows(200));
    let ahead = |rows, first_line| (200, Count { rows, first_line });
    assert_eq!(jumps(&format!("{good}99999,0.6,0,0.8\n")), ahead(1, 202));
    let three = format!("{good}500,0.6,0,0.8\n500.01,0.6,0,0.8\n500.02,0.6,0,0.8\n");
    assert_eq!(jumps(&three), ahead(3, 202));
    let goes_on = format!("{three}2.03,0.6,0,0.8\n");
    assert_eq!(
        jumps(&goes_on),
        (
            201,
            Count {
                rows: 3,
                first_line: 202
            }
        )
    );
    // A gap of seconds before the last row is a gap.
    let gap = read(format!("{good}9.0,0.6,0,0.8\n")).unwrap();
    assert_eq!((gap.rows.len(), gap.gaps.rows), (201, 1));
}

#[test]
fn cells_of_1e308_have_a_sentence_without_nan() {
    let absurd: String = (0..80)
        .map(|i| format!("{i},1e308,1e308,1e308\n"))
        .collect();
    let text = refusal(format!("{HEADER}{absurd}"));
    assert!(
        text.contains("mend the unit") && !text.contains("NaN"),
        "{text}"
    );
}

#[test]
fn ten_samples_per_second_are_not_taken_for_another_unit() {
    let slow: String = (0..80)
        .map(|i| format!("{}.{},0.6,0,0.8\n", i / 10, i % 10))
        .collect();
    let text = refusal(format!("{HEADER}{slow}"));
    assert!(text.contains("10.000 samples per second"), "{text}");
    assert!(text.contains("or record faster"), "{text}");
}

#[test]
fn zeros_behind_a_gzip_stream_are_let_pass() {
    let padded = [gzip(&format!("{HEADER}{}", rows(60))), vec![0; 512]].concat();
    let recording = read(padded).unwrap();
    assert_eq!((recording.rows.len(), recording.trailing_bytes), (60, true));
}

#[test]
fn paths_that_lead_nowhere() {
    let none =
        Recording::open(Path::new("no/such/file.csv"), Options::default(), None).unwrap_err();
    let expected =
        "no/such/file.csv: can't be read (there is no such file or folder); check the path";
    assert_eq!(none.to_string(), expected);
    let folder = Recording::open(
        Path::new(env!("CARGO_MANIFEST_DIR")),
        Options::default(),
        None,
    );
    assert!(folder.unwrap_err().to_string().contains("it is a folder"));
}
