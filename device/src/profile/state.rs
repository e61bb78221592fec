//! The judgement on two channels as one byte on the bus (object 2021h).
//!
//! In: a [`Judgement`]. Out: its code.
//!
//! | code | judgement |
//! |---|---|
//! | 0 | waiting: no comparison now, and nobody is accused |
//! | 1 | both measure and agree |
//! | 2 | they differ, not yet for long |
//! | 3 | paper: stop the motion and stand still |
//! | 4 | paper: the data had been late |
//! | 5 | paper: physical fault |
//! | 6 | product: they have differed for too long |
//! | 7 | product: this channel is faulty |
//! | 8 | product: the other channel is faulty |
//! | 9 | product: neither measures |
//!
//! Left out: the reason of a channel that is faulty, which 2025h tells.

use tilt::cross_check::{Judgement, Member};

/// The code of a judgement.
pub const fn state_code(judgement: Judgement) -> u8 {
    match judgement {
        Judgement::Waiting(_) => 0,
        Judgement::Agree => 1,
        Judgement::Warning => 2,
        Judgement::StopMotion => 3,
        Judgement::DataDelay => 4,
        Judgement::PhysicalFault => 5,
        Judgement::Disagree => 6,
        Judgement::OneChannel {
            faulty: Member::Own,
            ..
        } => 7,
        Judgement::OneChannel {
            faulty: Member::Peer,
            ..
        } => 8,
        Judgement::NoChannel(_) => 9,
    }
}
