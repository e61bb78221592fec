//! A device that judges by the paper's rule (2003h = 1): from when on, and a peer that is absent.
//!
//! In: NMT, error control and exchange of a peer. Out: state and validity of TPDO 1, EMCY.

use crate::played::{Pair, level, tilted};
use canopen::object::{Value, at};
use tilt::chain::Invalid;

/// OPERATIONAL and agreeing by the paper's rule, which counts from the reset behind its choice.
fn judging() -> Pair {
    let mut pair = Pair::new();
    pair.write(at(0x2003, 0), Value::u8(1));
    pair.write(at(0x1010, 1), Value::u32(canopen::storage::SAVE));
    pair.hears(0, &[129, 1]);
    pair.seconds(1.0);
    pair.at_work()
}

#[test]
fn the_paper_s_rule_is_taken_at_the_next_reset() {
    let mut pair = Pair::new();
    pair.write(at(0x2003, 0), Value::u8(1));
    let mut pair = pair.at_work();
    pair.peer.sends = tilted(1.0);
    pair.seconds(1.0);
    assert_eq!(pair.told().state, 6, "still the product's");
    let mut pair = judging();
    pair.peer.sends = tilted(1.0);
    pair.seconds(1.0);
    assert_eq!(pair.told().state, 2);
    assert!(pair.told().is_valid(), "a warning is part of the work");
    assert_eq!(pair.emergencies(), [0_u16; 0]);
    pair.seconds(1.5);
    assert_eq!(pair.told().state, 3);
    assert_eq!(pair.emergencies(), [0xFF11]);
}

/// An update of the peer, or its stay in PRE-OPERATIONAL, was a physical fault after a minute. A
/// peer that falls silent without a word still is.
#[test]
fn a_peer_that_had_announced_its_absence_was_a_physical_fault_in_paper_mode() {
    let announced: [&[u8]; 4] = [&[0], &[127], &[4], &[0xFF]];
    for word in announced {
        let mut pair = judging();
        pair.peer.silent = true;
        pair.hears(0x702, word);
        for _ in 0..150 {
            pair.seconds(0.5);
            let told = pair.told();
            assert_eq!((told.is_valid(), told.state), (true, 0), "{word:?}");
        }
        pair.peer.silent = false;
        pair.peer.sends = level().refused(Invalid::Settling);
        pair.seconds(1.0);
        assert_eq!(pair.told().state, 0, "{word:?}: it starts");
        pair.peer.sends = level();
        pair.seconds(1.0);
        assert_eq!(pair.told().state, 1, "{word:?}");
        pair.peer.silent = true;
        pair.seconds(50.0);
        assert_eq!(pair.told().state, 5, "{word:?}: the next silence counts");
    }
    let at_work: [&[u8]; 3] = [&[], &[5], &[0x85]];
    for word in at_work {
        let mut pair = judging();
        pair.peer.silent = true;
        pair.hears(0x702, word);
        pair.seconds(3.0);
        assert_eq!(pair.told().state, 3, "{word:?}");
        pair.seconds(46.0);
        assert_eq!(pair.told().state, 5, "{word:?}");
    }
}
