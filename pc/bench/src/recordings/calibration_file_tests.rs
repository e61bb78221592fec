//! Calibration files: written and read back, refused when they are anything else.

use proptest::prelude::*;

use super::*;

fn save(path: &Path, channels: &[Channel]) -> Result<(), FileError> {
    put_in_place(path, stage(path, channels, Existing::Replace)?)
}

/// A channel as a pose calibration leaves it.
pub fn channel() -> Channel {
    let vector = Vector::from_real(
        [
            [1.01, 0.02, -0.01],
            [0.015, 0.98, 0.03],
            [-0.02, 0.01, 1.005],
        ],
        [0.02, -0.031, 0.005],
    );
    let about = Channel {
        source: "exp1.csv.gz".to_owned(),
        method: Method::Poses,
        poses: 21,
        norm_residual_mg: 0.212_345_678_912_345,
        angle_residual_deg: None,
        rate_hz: 62.5,
        numbers_per_g: 2048.0,
        matrix_q30: [[0; 3]; 3],
        offset_q26: [0; 3],
        matrix: [[0.0; 3]; 3],
        offset_g: [0.0; 3],
        harmonics: [HarmonicSteps {
            cosine_steps: [1, -2, 3],
            ..Default::default()
        }; 2],
        temperature: None,
        budget: BudgetSteps {
            noise_q26: 200_000,
            ..Default::default()
        },
    };
    Channel::with_vector(about, &vector.unwrap())
}

/// The file's text with a valid CRC after `change` was made to its channels.
fn resealed(change: impl Fn(&mut Value)) -> String {
    let mut file: Value = serde_json::from_str(&to_text(&[channel()]).unwrap()).unwrap();
    change(&mut file["channels"]);
    let crc = checksum(&file["channels"]);
    file["crc32"] = json!(format!("{crc:08x}"));
    file.to_string()
}

fn refused(text: &str) -> Problem {
    from_text(text.as_bytes(), 1).unwrap_err()
}

#[test]
fn the_crc_is_crc_32() {
    let mut crc = flate2::Crc::new();
    crc.update(b"123456789");
    assert_eq!(crc.sum(), 0xcbf4_3926);
}

#[test]
fn written_and_read_back() {
    let written = [channel(), channel()];
    let text = to_text(&written).unwrap();
    let read = from_text(text.as_bytes(), 2).unwrap();
    assert_eq!(read[0].vector(), written[0].vector());
    assert_eq!(read[1].norm_residual_mg, 0.212_345_679);
    assert_eq!(to_text(&read).unwrap(), text);
    // Indentation is free, content is not.
    let compact = serde_json::from_str::<Value>(&text).unwrap().to_string();
    assert_eq!(from_text(compact.as_bytes(), 2).unwrap(), read);
    let Correction::TwoAxis { vector, harmonics } = read[0].calibration().correction else {
        panic!("another correction");
    };
    assert_eq!(
        (vector, harmonics.y.cosine),
        (written[0].vector(), [1, -2, 3])
    );
    assert_eq!(read[0].calibration().budget.noise, 200_000);
}

#[test]
fn a_file_of_before_the_span_is_read_and_kept_as_it_is() {
    let text = to_text(&[channel()]).unwrap();
    assert!(!text.contains("span_q8"), "as files were written before");
    let read = from_text(text.as_bytes(), 1).unwrap();
    let budget = read[0].calibration().budget;
    assert_eq!((budget.tco, budget.span), (TCO, Span::REFERENCE));
    assert_eq!(to_text(&read).unwrap(), text);
    let mut compensated = channel();
    compensated.temperature = Some(TemperatureSteps {
        offset1_q8: [0; 3],
        offset2_q16: [0; 3],
        gain1_q38: [0; 3],
        gain2_q46: [0; 3],
    });
    assert_eq!(compensated.calibration().budget.span, Span::CHAMBER);
    compensated.budget.span_q8 = Some([5120, 5376]);
    compensated.budget.tco_q26 = Some(7);
    let text = to_text(&[compensated]).unwrap();
    let budget = from_text(text.as_bytes(), 1).unwrap()[0]
        .calibration()
        .budget;
    let at = Temperature::from_celsius;
    let span = Span {
        low: at(20),
        high: at(21),
    };
    assert_eq!((budget.tco, budget.span), (7, span));
}

#[test]
fn anything_else_is_refused() {
    let text = to_text(&[channel()]).unwrap();
    assert!(matches!(refused(""), Problem::Malformed(_)));
    assert!(matches!(refused("[1, 2]"), Problem::Format(_)));
    assert!(matches!(
        refused(&text[..text.len() / 2]),
        Problem::Malformed(_)
    ));
    assert_eq!(
        refused(&text.replace(FORMAT, "other")),
        Problem::Format(FORMAT)
    );
    let newer = refused(&text.replace("\"version\": 1", "\"version\": 7"));
    assert!(
        newer
            .to_string()
            .starts_with("version 7 can't be read here, only version 1")
    );
    let changed = refused(&text.replace("\"poses\": 21", "\"poses\": 22"));
    assert!(matches!(changed, Problem::Crc { .. }));
    assert!(
        changed.to_string().contains("changed or damaged"),
        "{changed}"
    );
    let none = refused(&text.replace("crc32", "crc"));
    assert!(matches!(none, Problem::Crc { .. }));
    let two = from_text(text.as_bytes(), 2).unwrap_err();
    assert_eq!(
        two,
        Problem::ChannelCount {
            found: 1,
            expected: 2
        }
    );
    let quoted = refused(&resealed(|c| c[0]["method"] = json!("a\u{1b}\nb")));
    assert!(!quoted.to_string().contains(char::is_control), "{quoted:?}");
    assert!(matches!(
        refused(&resealed(|c| c[0]["matrix"] = json!(7))),
        Problem::Malformed(_)
    ));
}

#[test]
fn values_that_no_sensor_has_are_refused() {
    let why = |change: &dyn Fn(&mut Value)| match refused(&resealed(change)) {
        Problem::Channel(1, why) => why,
        other => panic!("{other:?}"),
    };
    assert_eq!(
        why(&|c| c[0]["matrix_q30"][0][1] = json!(1u64 << 31)),
        Impossible::Gain
    );
    assert_eq!(
        why(&|c| c[0]["matrix"][0][1] = json!(-2.5)),
        Impossible::Gain
    );
    assert_eq!(
        why(&|c| c[0]["offset_q26"][2] = json!(1 << 27)),
        Impossible::Offset
    );
    assert_eq!(why(&|c| c[0]["rate_hz"] = json!(-1)), Impossible::Number);
    assert_eq!(
        why(&|c| c[0]["numbers_per_g"] = json!(0)),
        Impossible::Number
    );
    assert_eq!(
        why(&|c| c[0]["matrix"][1][1] = json!(0.97)),
        Impossible::Disagree
    );
    let flat = |c: &mut Value| {
        c[0]["matrix_q30"][2] = c[0]["matrix_q30"][1].clone();
        c[0]["matrix"][2] = c[0]["matrix"][1].clone();
    };
    assert_eq!(why(&flat), Impossible::Singular);
    for (matrix, expected) in [
        (
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]],
            Impossible::Mirrored,
        ),
        (
            [[1.0, 0.4, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            Impossible::Shear,
        ),
        (
            [[1.0, 0.0, 0.0], [0.0, 0.45, 0.0], [0.0, 0.0, 1.0]],
            Impossible::Stretch,
        ),
        (
            [[1.5, 0.0, 1.5], [0.0, 1.0, 0.0], [-1.5, 0.0, 1.5]],
            Impossible::Stretch,
        ),
    ] {
        let vector = Vector::from_real(matrix, [0.0; 3]).unwrap();
        let bent = Channel::with_vector(channel(), &vector);
        assert_eq!(bent.check(), Err(expected), "{matrix:?}");
    }
    let mut broken = channel();
    broken.norm_residual_mg = f64::NAN;
    assert_eq!(
        to_text(&[broken]),
        Err(Problem::Channel(1, Impossible::Number))
    );
}

#[test]
fn saved_whole_or_not_at_all() {
    let folder = std::env::temp_dir().join(format!("plumb-calibration-{}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    let path = folder.join("a.json");
    save(&path, &[channel()]).unwrap();
    save(&path, &[channel(), channel()]).unwrap();
    assert_eq!(load(&path, 2).unwrap().len(), 2);
    let mut broken = channel();
    broken.offset_q26 = [1 << 40; 3];
    assert!(save(&path, &[broken]).is_err());
    assert_eq!(load(&path, 2).unwrap().len(), 2, "the old file must stay");
    let nowhere = save(&folder.join("none/b.json"), &[channel()])
        .unwrap_err()
        .to_string();
    assert!(nowhere.contains("b.json: can't be written"), "{nowhere}");
    assert!(
        load(&folder, 1)
            .unwrap_err()
            .to_string()
            .contains("it is a folder")
    );
    let missing = load(&folder.join("c.json"), 1).unwrap_err().to_string();
    assert!(
        missing.contains("c.json: can't be read (there is no such file"),
        "{missing}"
    );
    assert_eq!(
        fs::read_dir(&folder).unwrap().count(),
        1,
        "temporary files must be gone"
    );
    fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn only_the_name_of_a_recording_is_kept() {
    assert_eq!(base_name("../some/where/x.csv"), "x.csv");
    assert_eq!(base_name("x.csv"), "x.csv");
}

proptest! {
    #[test]
    fn any_sound_channel_comes_back(
        matrix in prop::array::uniform9(-0.3f64..0.3),
        offset in prop::array::uniform3(-0.9f64..0.9),
        residual in 0.0f64..500.0,
        rate in 25.0f64..10_000.0,
    ) {
        let [a, b, c, d, e, f, g, h, i] = matrix;
        let rows = [[1.0 + a, b, c], [d, 1.0 + e, f], [g, h, 1.0 + i]];
        let vector = Vector::from_real(rows, offset).unwrap();
        let about = Channel { norm_residual_mg: residual, rate_hz: rate, ..channel() };
        let written = Channel::with_vector(about, &vector);
        prop_assume!(written.check().is_ok());
        let text = to_text(std::slice::from_ref(&written)).unwrap();
        let read = from_text(text.as_bytes(), 1).unwrap();
        prop_assert_eq!(read[0].vector(), vector);
    }
}

#[test]
fn numbers_under_the_crc_are_written_as_documented() {
    let page = include_str!("../../../../docs/calibration-format.md");
    for value in [1.0, 0.1, -0.000012, 1e-6, 1.25e-9, 123_456.5, 1e16] {
        let text = Value::from(value).to_string();
        println!("{text}");
        assert!(
            page.contains(&format!("`{text}`")),
            "{text} is not in the page"
        );
        assert_eq!(text.parse::<f64>().unwrap(), value);
    }
}

#[test]
#[cfg(unix)]
fn an_endless_file_is_too_large() {
    let endless = Path::new("/dev/zero");
    if endless.exists() {
        assert_eq!(load(endless, 1).unwrap_err().problem, Problem::TooLarge);
    }
}
