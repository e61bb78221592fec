//! Which services of those that the standards leave optional a device has.
//!
//! In: the choice of the application ([`Objects::SERVICES`](crate::object::Objects::SERVICES)), a
//! constant, so that what is left out is not linked. Out: whether an object is served at all.
//!
//! A device without a service answers as one that never had it: its objects do not exist, whatever
//! the table lists, and its frames are those of somebody else.
//!
//! Left out: services that need no code of their own but their rows (1020h, 1029h, 1F80h): those
//! a device leaves out by leaving out the rows.

use crate::object::{Abort, Address};

/// The optional services that there are; `false` leaves one out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Services {
    /// SRDOs and the global fail-safe command (EN 50325-5; 1300h to 13FFh).
    pub safety: bool,
    /// Node and life guarding (CiA 301, 7.2.8.2.2; 100Ch and 100Dh).
    pub guarding: bool,
    /// Supervision of other nodes' heartbeats (1016h).
    pub heartbeat_consumer: bool,
    /// SYNC of this node's own (1005h bit 30, 1006h), and its standing in for one that is missing.
    pub sync_producer: bool,
    /// SDO block upload.
    pub block_upload: bool,
    /// SDO block download.
    pub block_download: bool,
    /// Layer setting services as a whole (CiA 305).
    pub lss: bool,
    /// Of these, fastscan.
    pub fastscan: bool,
    /// Inhibit time and event timer of TPDOs, deadlines of RPDOs (sub-indices 3 and 5).
    pub pdo_timers: bool,
    /// Remote frames that ask for TPDOs.
    pub pdo_remote: bool,
    /// Mappings of PDOs that a tool may change.
    pub dynamic_mapping: bool,
    /// Store and restore of parameters (1010h and 1011h); without it only defaults come in.
    pub storage: bool,
}

impl Services {
    /// Everything.
    pub const ALL: Self = Self {
        safety: true,
        guarding: true,
        heartbeat_consumer: true,
        sync_producer: true,
        block_upload: true,
        block_download: true,
        lss: true,
        fastscan: true,
        pdo_timers: true,
        pdo_remote: true,
        dynamic_mapping: true,
        storage: true,
    };

    /// No more than the standards ask of every device.
    pub const LEAST: Self = Self {
        safety: false,
        guarding: false,
        heartbeat_consumer: false,
        sync_producer: false,
        block_upload: false,
        block_download: false,
        lss: false,
        fastscan: false,
        pdo_timers: false,
        pdo_remote: false,
        dynamic_mapping: false,
        storage: false,
    };

    /// Whether the services that there are serve this object.
    ///
    /// Errors: [`Abort::NoSuchObject`], or [`Abort::NoSuchSubIndex`] where the object has others.
    // Of constants nothing is left of it, or only what was left out.
    #[inline(always)]
    pub const fn serve(&self, at: Address) -> Result<(), Abort> {
        let is_there = match at.index {
            0x1006 => self.sync_producer,
            0x100C | 0x100D => self.guarding,
            0x1010 | 0x1011 => self.storage,
            0x1016 => self.heartbeat_consumer,
            0x1300..=0x13FF => self.safety,
            0x1400..=0x15FF | 0x1800..=0x19FF if matches!(at.sub, 3 | 5) => {
                return if self.pdo_timers {
                    Ok(())
                } else {
                    Err(Abort::NoSuchSubIndex)
                };
            }
            _ => true,
        };
        if is_there {
            Ok(())
        } else {
            Err(Abort::NoSuchObject)
        }
    }
}
