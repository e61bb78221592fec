//! What a bus counts: frames, errors and the time in which it was not idle.
//!
//! In: nothing. Out: [`Statistics`], a snapshot; the load of a window is that between two of them.

/// Counts since the bus was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// When the snapshot was taken, ns.
    pub at_ns: u64,
    /// Time with a frame, an error frame or their intermission on the bus, ns.
    pub busy_ns: u64,
    /// Attempts to send a frame.
    pub attempts: u64,
    /// Frames sent and acknowledged.
    pub sent: u64,
    /// Attempts that failed.
    pub errors: u64,
    /// Times a controller had to let another one go first.
    pub arbitrations_lost: u64,
}

impl Statistics {
    /// Bus load between an earlier snapshot and this one, 0 to 1; 0 for a window without length.
    pub fn load_since(&self, earlier: &Self) -> f64 {
        match self.at_ns.saturating_sub(earlier.at_ns) {
            0 => 0.0,
            window_ns => self.busy_ns.saturating_sub(earlier.busy_ns) as f64 / window_ns as f64,
        }
    }
}
