//! Instruments of several logs joined: the same in every order and every grouping.

use listen::{Emergency, Round};
use proptest::prelude::*;

use super::Instrument;

const S: u64 = 1_000_000_000;

/// Codes of three faults, of the end of all, and of a bus error.
const CODES: [u16; 5] = [0xFF01, 0xFF13, 0xFF15, 0, 0x8130];

/// What a log has of an instrument in which this happened, at these seconds.
fn noted(mut notes: Vec<(u64, u8, usize)>) -> Instrument {
    notes.sort_unstable();
    let mut instrument = Instrument::default();
    for (second, side, code) in notes {
        let now_ns = second * S;
        instrument.recorder.record(&Round::at(now_ns));
        let told = Emergency {
            code: CODES[code],
            register: 0x81,
            bytes: [0, 0, 0, 0x80 | 15, 8],
        };
        if let Some((place, true)) = instrument.events.emergency(now_ns, side, &told)
            && let Some(plot) = instrument.recorder.trigger(now_ns)
        {
            instrument.events.in_plot(place, plot);
        }
        let (first, _) = instrument.span_ns.unwrap_or((now_ns, now_ns));
        instrument.span_ns = Some((first, now_ns));
        instrument.events.beat(now_ns, side);
        if second % 7 == 0 {
            instrument.events.restarted(now_ns, side);
        }
        instrument.sdo(
            now_ns,
            side.into(),
            &[0x43, 0x18, 0x10, 4, code as u8, 0, 0, 0],
        );
    }
    if let Some((_, last_ns)) = instrument.span_ns {
        instrument.events.finish(last_ns);
    }
    instrument
}

fn merged(parts: &[&Instrument]) -> Instrument {
    let mut all = Instrument::default();
    parts.iter().for_each(|part| all.merge(part));
    all
}

/// All that is kept of it, and the events that are read out of it.
fn text(instrument: &Instrument) -> String {
    serde_json::to_string(&(instrument, instrument.events.concluded())).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// More events and captures than there is room for, many at the same time.
    #[test]
    fn merged_logs_are_the_same_in_any_order_and_grouping(
        notes in prop::collection::vec((0..2_000_u64, 0..2_u8, 0..CODES.len(), 0..3_usize), 0..700),
    ) {
        let of = |part| {
            let own = notes.iter().filter(|note| note.3 == part);
            noted(own.map(|note| (note.0, note.1, note.2)).collect())
        };
        let [a, b, c] = [0, 1, 2].map(of);
        let whole = text(&merged(&[&a, &b, &c]));
        for order in [[&a, &c, &b], [&b, &a, &c], [&b, &c, &a], [&c, &a, &b], [&c, &b, &a]] {
            prop_assert_eq!(&text(&merged(&order)), &whole);
        }
        let groups = [merged(&[&c, &a]), merged(&[&b])];
        prop_assert_eq!(&text(&merged(&[&groups[0], &groups[1]])), &whole);
        prop_assert_eq!(&text(&merged(&[&b, &merged(&[&a, &c])])), &whole);
    }

    #[test]
    fn what_is_kept_is_read_back_as_it_was(
        notes in prop::collection::vec((0..2_000_u64, 0..2_u8, 0..CODES.len()), 0..100),
    ) {
        let noted = noted(notes);
        let kept = serde_json::to_vec(&noted).unwrap();
        let back: Instrument = serde_json::from_slice(&kept).unwrap();
        prop_assert_eq!(text(&back), text(&noted));
    }
}
