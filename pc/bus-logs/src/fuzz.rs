//! Whatever stands in a log, every line is counted once and nothing grows.

use canopen::Frame;
use proptest::prelude::*;

use super::*;
use crate::sniff::Kind;
use output::progress::Progress;

/// Bytes as logs have them, so that random text comes near to being one.
fn text() -> impl Strategy<Value = Vec<u8>> {
    let piece = prop_oneof![
        Just(b"(1700000000.123456) can0 181#E803000000".to_vec()),
        Just(b"(1700000000.123456) can0 181##0E803".to_vec()),
        Just(b"   0.010000 1  181  Rx   d 2 E8 03".to_vec()),
        Just(b"base hex  timestamps absolute".to_vec()),
        Just(b"date Tue Nov 14 10:13:20.123 pm 2023".to_vec()),
        Just(b"  can0  181   [2]  E8 03".to_vec()),
        Just(b"0.5 CANFD 1 Rx 181 0 0 2 2 E8 03 130000 130 1000 0".to_vec()),
        "[()#.0-9A-FRTdrx \\[\\]-]{0,30}".prop_map(String::into_bytes),
        proptest::collection::vec(any::<u8>(), 0..40),
        Just(b"\n".to_vec()),
        Just(b"\r\n".to_vec()),
    ];
    proptest::collection::vec(piece, 0..40).prop_map(|pieces| pieces.concat())
}

fn lines_of(bytes: &[u8]) -> u64 {
    let ends = bytes.iter().filter(|byte| **byte == b'\n').count() as u64;
    ends + u64::from(!bytes.is_empty() && !bytes.ends_with(b"\n"))
}

proptest! {
    #[test]
    fn every_line_is_a_frame_or_counted(bytes in text(), asc: bool) {
        let first: &[u8] = if asc { b"base hex\n" } else { b"(1.0) can0 080#\n" };
        let bytes = [first, &bytes].concat();
        let input = input::Input::new(std::io::Cursor::new(bytes.clone()), None).unwrap();
        let kind = if asc { Kind::Asc } else { Kind::Candump };
        let mut reader = reader::Reader::new("x".into(), 0, input, kind, 0);
        let mut interfaces = reader::Interfaces::new(None);
        let mut skipped = Skipped::default();
        let mut frames = 0;
        while let Some(logged) = reader.next(&mut interfaces, &mut skipped).unwrap() {
            frames += 1;
            prop_assert!(usize::from(logged.interface) < interfaces.names().len());
        }
        prop_assert_eq!(frames + skipped.lines(), lines_of(&bytes));
    }

    #[test]
    fn what_is_written_is_read_back(
        frames in proptest::collection::vec(
            (0..4_000_000_000_000_000_u64, any::<bool>(), 0..0x2000_0000_u32, any::<bool>(),
             proptest::collection::vec(any::<u8>(), 0..9)),
            1..20),
        asc: bool,
    ) {
        use canopen::frame::{ExtendedId, Id};
        let format = if asc { Format::Asc } else { Format::Candump };
        let mut writer = Writer::new(Vec::new(), format);
        let mut written = Vec::new();
        // An ASC has no times before its first.
        let mut time_us = 0;
        for (us, extended, id, remote, bytes) in frames {
            time_us = if time_us == 0 { us } else { time_us + us % 1_000_000_000 };
            let id = if extended {
                Id::Extended(ExtendedId::new(id).unwrap())
            } else {
                Id::Standard(canopen::frame::standard(id as u16))
            };
            let frame = if remote {
                Frame::remote(id, bytes.len())
            } else {
                Frame::with(id, &bytes)
            };
            let frame = frame.unwrap();
            writer.write(time_us * 1000, "can0", &frame).unwrap();
            written.push((time_us * 1000, frame));
        }
        let text = writer.finish().unwrap();
        let head = sniff::look(&text);
        prop_assert_eq!(head.kind, Some(if asc { Kind::Asc } else { Kind::Candump }));
        prop_assert_eq!(head.first_ns, Some(written[0].0));
        let input = input::Input::new(std::io::Cursor::new(text), None).unwrap();
        let mut reader = reader::Reader::new("x".into(), 0, input, head.kind.unwrap(), 0);
        let mut interfaces = reader::Interfaces::new(None);
        let mut skipped = Skipped::default();
        for (time_ns, frame) in written {
            let logged = reader.next(&mut interfaces, &mut skipped).unwrap().unwrap();
            prop_assert_eq!((logged.time_ns, logged.frame), (time_ns, frame));
        }
        prop_assert_eq!(reader.next(&mut interfaces, &mut skipped).unwrap(), None);
        prop_assert_eq!(skipped.lines(), skipped.tally(Skip::NoFrame).count);
    }
}

#[test]
fn a_progress_that_shows_nothing_does_not_matter() {
    let missing = Source::open(&["/no/such/file".into()], &Progress::hidden());
    assert!(missing.is_err_and(|error| error.to_string().contains("/no/such/file")));
}
