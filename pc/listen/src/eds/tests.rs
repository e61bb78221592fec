//! Sheets as they are found in the world, each written here for what is odd about it.

use device::objects::table::{self, Channel};
use proptest::prelude::*;

use super::sheet::Oddity;
use super::*;
use crate::NodePlan;

/// An encoder as somebody's tool would write it: one PDO with position and speed.
const ENCODER: &str = "\
[FileInfo]
FileName=encoder.eds
[DeviceInfo]
VendorName=Somebody
ProductName=Encoder
[MandatoryObjects]
SupportedObjects=1
1=0x1000
[1000]
ParameterName=Device type
DataType=0x0007
DefaultValue=0x00020196
[1800]
ParameterName=TPDO 1
SubNumber=3
[1800sub0]
DataType=5
DefaultValue=2
[1800sub1]
DataType=7
DefaultValue=$NODEID+0x180
[1800sub2]
DataType=5
DefaultValue=255
[1A00sub0]
DataType=5
DefaultValue=2
[1A00sub1]
DataType=7
DefaultValue=0x60040020
[1A00sub2]
DataType=7
DefaultValue=0x60300110
[6004]
ParameterName=Position value
DataType=0x0007
[6030]
ParameterName=Speed value
[6030sub1]
ParameterName=Channel 1
DataType=0x0003
";

fn device(text: &[u8], node_id: u8) -> Device {
    Device::new("x.eds".into(), node_id, &Sheet::parse(text))
}

fn oddities(device: &Device) -> Vec<(u32, Oddity)> {
    let all = device.warnings.iter();
    all.map(|warning| (warning.line, warning.what.clone()))
        .collect()
}

fn line_of(text: &str, what: &str) -> u32 {
    let at = text.lines().position(|line| line == what);
    at.unwrap() as u32 + 1
}

/// The encoder with one line changed; what is odd about it then.
fn changed(from: &str, to: &str) -> (Device, Vec<(u32, Oddity)>, u32) {
    assert!(ENCODER.contains(from));
    let device = device(ENCODER.replacen(from, to, 1).as_bytes(), 5);
    let found = oddities(&device);
    (
        device,
        found,
        line_of(ENCODER, from.lines().next().unwrap()),
    )
}

fn is_the_encoder(device: &Device) {
    let [pdo] = device.pdos.as_slice() else {
        panic!("{:?}", device.pdos);
    };
    assert_eq!((pdo.cob_id, pdo.every), (0x185, 0));
    let names: Vec<_> = pdo
        .signals
        .iter()
        .map(|signal| signal.name.as_str())
        .collect();
    assert_eq!(names, ["Position value", "Speed value Channel 1"]);
    let bytes = [1, 0, 0, 0x80, 0xFE, 0xFF, 0, 0];
    let values: Vec<_> = pdo
        .signals
        .iter()
        .map(|signal| signal.value(bytes))
        .collect();
    assert_eq!(values, [2_147_483_649.0, -2.0]);
}

#[test]
fn a_sheet_as_it_should_be_gives_no_warning() {
    let plain = device(ENCODER.as_bytes(), 5);
    is_the_encoder(&plain);
    assert_eq!(oddities(&plain), []);
    assert_eq!(plain.product, "Encoder");
    assert!(!plain.is_inclinometer());
}

#[test]
fn what_tools_do_to_line_ends_marks_and_letters_is_let_be() {
    for text in [
        ENCODER.replace('\n', "\r\n"),
        ENCODER.replace('\n', "\r"),
        format!("\u{feff}{ENCODER}"),
        ENCODER
            .replace("sub", "SUB")
            .replace("ParameterName", "parametername"),
        ENCODER.replace("[1A00sub1]", "[1a00Sub1] ; mapped"),
        ENCODER.replace('=', " = "),
        ENCODER.replace("$NODEID+0x180", "0x180 + $nodeid"),
        ENCODER.replace("DataType=5", "DataType=0x0005"),
        ENCODER.replace("DataType=5", "DataType=005"),
        format!("; a note\n# another\n\n{ENCODER}"),
    ] {
        let device = device(text.as_bytes(), 5);
        is_the_encoder(&device);
        assert_eq!(oddities(&device), [], "{text}");
    }
}

#[test]
fn what_is_odd_and_can_be_understood_is_a_warning_with_its_line() {
    let (device, found, line) = changed("ProductName=Encoder", "ProductName=Encoder\nno key");
    is_the_encoder(&device);
    assert_eq!(found, [(line + 1, Oddity::NoKey)]);
    let (device, found, line) = changed("1=0x1000", "1=0x1000\n2=0x1001");
    is_the_encoder(&device);
    let want = [
        (line - 1, Oddity::ListCount(1, 2)),
        (line + 1, Oddity::List(0x1001)),
    ];
    assert_eq!(found, want);
    let (device, found, line) = changed("DefaultValue=255", "DefaultValue=255\nDefaultValue=1");
    is_the_encoder(&device);
    assert_eq!(found, [(line + 1, Oddity::KeyTwice("defaultvalue".into()))]);
    let (device, found, line) = changed("[6004]", "[1000]\nx=1\n[6004]");
    is_the_encoder(&device);
    assert_eq!(found, [(line, Oddity::SectionTwice("1000".into()))]);
    let (device, found, line) = changed("DefaultValue=255", "DefaultValue=0FFh");
    is_the_encoder(&device);
    assert_eq!(found, [(line, Oddity::OddNumber("0FFh".into()))]);
    let (device, found, line) = changed("DefaultValue=0x00020196", "DefaultValue=what");
    is_the_encoder(&device);
    assert_eq!(found, [(line, Oddity::NoNumber("what".into()))]);
    let (device, found, _) = changed("[FileInfo]", "Key=1\n[FileInfo]");
    is_the_encoder(&device);
    assert_eq!(found, [(1, Oddity::NoSection)]);
    let (device, found, line) = changed("[1000]", "[1018subX]\n[1000]");
    is_the_encoder(&device);
    assert_eq!(found, [(line, Oddity::NoIndex("1018subx".into()))]);
}

#[test]
fn letters_of_latin_1_are_read_as_such() {
    let text = ENCODER.replace("ProductName=Encoder", "ProductName=Ger#t");
    let bytes: Vec<_> = text
        .bytes()
        .map(|b| if b == b'#' { 0xE4 } else { b })
        .collect();
    let device = device(&bytes, 5);
    is_the_encoder(&device);
    assert_eq!(device.product, "Gerät");
    let line = line_of(ENCODER, "ProductName=Encoder");
    assert_eq!(oddities(&device), [(line, Oddity::Latin1)]);
}

#[test]
fn mappings_that_do_not_add_up_give_what_there_is() {
    for count in ["3", "0"] {
        let text = ENCODER.replace(
            "DefaultValue=2\n[1A00sub1]",
            &format!("DefaultValue={count}\n[1A00sub1]"),
        );
        let device = device(text.as_bytes(), 5);
        is_the_encoder(&device);
        let count = count.parse().unwrap();
        let want = Oddity::MappingCount(0x1A00, count, 2);
        assert_eq!(oddities(&device), [(line_of(ENCODER, "[1A00sub0]"), want)]);
    }
    let (device, found, _) = changed("DefaultValue=0x60300110", "DefaultValue=0x60300140");
    assert_eq!(device.pdos[0].signals.len(), 1);
    assert_eq!(found.len(), 1);
    let (device, _, _) = changed("[6004]", "[6003]");
    assert_eq!(device.pdos[0].signals[0].name, "6004h sub 0");
}

#[test]
fn a_pdo_that_is_off_or_of_29_bit_is_left_out() {
    let (device, found, _) = changed(
        "DefaultValue=$NODEID+0x180",
        "DefaultValue=$NODEID+0x80000180",
    );
    assert_eq!((device.pdos.len(), found.len()), (0, 0));
    let (device, found, _) = changed("DefaultValue=$NODEID+0x180", "DefaultValue=0x20012345");
    assert_eq!((device.pdos.len(), found.len()), (0, 1));
    // Without a COB-ID the first four have the one that is set aside for them.
    let (device, _, _) = changed("DefaultValue=$NODEID+0x180", "LowLimit=");
    is_the_encoder(&device);
    let dcf = ENCODER.replace(
        "DefaultValue=$NODEID+0x180",
        "DefaultValue=$NODEID+0x180\nParameterValue=0x1F0",
    );
    assert_eq!(self::device(dcf.as_bytes(), 5).pdos[0].cob_id, 0x1F0);
}

#[test]
fn our_own_sheets_are_the_plan_as_delivered_and_give_no_warning() {
    for channel in [Channel::A, Channel::B] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eds");
        let letter = if channel == Channel::A { 'a' } else { 'b' };
        let node_id = channel.node_id();
        let ours = ["plumb", "plumb-dynamic"].map(|instrument| {
            ["eds", "dcf"].map(|ending| format!("{instrument}-{letter}.{ending}"))
        });
        for name in ours.into_iter().flatten() {
            let request = Request {
                path: folder.join(&name),
                node_id: name.ends_with("eds").then_some(node_id),
            };
            let device = request.read().unwrap();
            assert_eq!(oddities(&device), [], "{name}");
            assert!(device.is_inclinometer());
            let mut plan = NodePlan::as_delivered(node_id);
            if !name.contains("dynamic") {
                // The last three are those of a gyroscope.
                plan.pdos.truncate(4);
            }
            assert_eq!(*device.plan(), plan, "{name}");
        }
    }
    assert!(!table::rows().is_empty());
}

#[test]
fn a_file_and_a_node_are_told_apart() {
    let request = |text: &str| text.parse::<Request>();
    assert_eq!(request("a.eds@5").unwrap().node_id, Some(5));
    assert_eq!(request("me@home/a.eds").unwrap().node_id, None);
    assert!(request("a.eds@128").is_err() && request("a.eds@0").is_err());
    let sentence = request("/no/such.eds@1")
        .unwrap()
        .read()
        .unwrap_err()
        .to_string();
    assert!(sentence.contains("/no/such.eds"), "{sentence}");
}

proptest! {
    #[test]
    fn any_bytes_are_a_sheet_with_bounded_warnings(bytes: Vec<u8>) {
        let device = device(&bytes, 1);
        prop_assert!(device.warnings.len() <= 100);
    }

    #[test]
    fn any_lines_of_a_sheet_in_any_order_do_no_harm(
        lines in proptest::collection::vec(
            (0..60_usize, proptest::option::of("[0-9a-fx$+=\\[\\]]{0,12}")), 0..80),
    ) {
        let known: Vec<_> = ENCODER.lines().collect();
        let text: Vec<_> = lines
            .iter()
            .map(|(at, own)| own.as_deref().unwrap_or(known[at % known.len()]))
            .collect();
        let device = device(text.join("\n").as_bytes(), 127);
        for signal in device.pdos.iter().flat_map(|pdo| &pdo.signals) {
            prop_assert!(signal.shift + signal.bits <= 64);
            let _ = signal.value([0xA5; 8]);
        }
    }
}
