//! What follows from all that is known: the values shown, faults, EMCY, the fault log, consent.
//!
//! In: the channel, the pair's judgement, the memory's state, the time. Out: the values of the
//! dictionary as they move without a SYNC, one EMCY for each fault that appears and one when
//! faults have gone, an entry in the log with the samples around it, and whether safety frames
//! may go out.
//!
//! Left out: how a judgement comes about (`pair`).

use canopen::nmt::State;
use instant::Instant;
use tilt::angle::Angle;
use tilt::chain::Invalid;
use tilt::cross_check::Judgement;
use tilt::observation::Observation;

use super::{Device, Memory, REFRESH_US};
use crate::calibration::encoding::identity;
use crate::exchange::Pdos;
use crate::fault::{Fault, Faults};
use crate::fault_log::Entry;
use crate::instrument::Instrument;
use crate::objects::process::SyncSource;
use crate::objects::safety::VALID;
use crate::profile::Resolution;
use crate::sensor::Part;

/// Outside these the part is not specified (DS11811, table 4), in 1/256 degC.
const COLDEST: i32 = -40 * 256;
/// See [`COLDEST`].
const HOTTEST: i32 = 85 * 256;

/// Time between two looks at the calibration in force, us.
const SUM_INTERVAL_US: i64 = 250_000;

/// A slope that was outside the measuring range has come back when it is inside by this much,
/// 0.001 deg, so that noise at the end of the range does not make an EMCY of each sample.
const BACK: i32 = 200;

/// Whether a slope is outside a measuring range, 0.001 deg, or `stood` there and is not back.
fn outside(slope: Angle, low: i32, high: i32, stood: bool) -> bool {
    // In the middle of a narrow range a slope is back in any case.
    let narrow = high.saturating_sub(low) / 4;
    let margin = if stood { BACK.min(narrow) } else { 0 };
    let inside = low.saturating_add(margin)..=high.saturating_sub(margin);
    !inside.contains(&Resolution::Thousandth.units(slope))
}

impl<P: Part, M: Memory, I: Instrument> Device<P, M, I> {
    /// What every event of the bus ends with: whatever has happened may be due sooner than what was
    /// known. The poll that follows at once reports it.
    pub(super) fn after(&mut self, now: Instant) {
        self.next = now;
        self.exchanged(now);
    }

    /// What a PDO of the peer's exchange ends with: hardly ever anything that hurries.
    pub(super) fn exchanged(&mut self, now: Instant) {
        let pending = &self.parts.values.pending;
        if pending.exchange != Pdos::NONE && self.pair_up(now) && self.report(now) {
            self.next = now;
        }
    }

    /// What moves without a SYNC: the angle for SDOs, SRDOs and event-driven PDOs, counters, time.
    pub(super) fn refresh(&mut self, now: Instant) {
        self.check_calibration(now);
        // A reading of a SYNC is left as it is, unless the channel has found a fault since.
        let age_us = now.micros_since(self.parts.values.process.measured_at);
        if age_us >= REFRESH_US || self.parts.channel.reason().is_some() {
            let reading = self.parts.channel.reading(&self.parts.settings, now);
            self.parts.values.process.measure(&reading, now);
            self.parts.take_moment(now);
        }
        let unheard = self.parts.values.process.source == SyncSource::None;
        if unheard || self.parts.values.state != State::Operational {
            // No SYNC sets when to tell the peer, or it is not told: then 2010h is what is so now.
            let own_fault = self.parts.pair.own_fault();
            let observation = Observation::from(self.parts.values.process.measured);
            let shown = self.parts.presentation();
            self.parts.values.tell(&observation, own_fault, shown, now);
        }
        let channel = &self.parts.channel;
        let process = &mut self.parts.values.process;
        process.samples = channel.samples();
        process.period_q8 = channel.period_q8();
        if let Some((filtered, _)) = channel.filtered() {
            process.filtered = filtered.accel;
        }
        if let Some(t) = channel.temperature() {
            process.temperature_c = (t.0.saturating_add(128) >> 8).clamp(-128, 127) as i8;
        }
        process.bus.overruns = self.bus.overruns();
        self.look_for_sync(now);
        self.mend_sensor(now);
        self.look_for_faults(now);
        self.keep(now);
        let (bus, mut objects) = self.split(now);
        bus.data_changed(&mut objects, now);
    }

    /// A calibration that changes by itself makes wrong angles that look right.
    fn check_calibration(&mut self, now: Instant) {
        if now < self.next_sum {
            return;
        }
        self.next_sum = now.offset(SUM_INTERVAL_US);
        if identity(&self.parts.settings.chain.calibration) != self.parts.values.calibration_sum {
            self.parts.channel.condemn(Invalid::Corrupt);
        }
    }

    /// A sensor that has lost its set-up gets it again once the latch allows (2004h).
    fn mend_sensor(&mut self, now: Instant) {
        let curable = matches!(
            self.parts.channel.fault(),
            Some(Invalid::PartReset | Invalid::Bus | Invalid::Thermometer)
        );
        let wait_us = i64::from(self.parts.values.parameters.latch_s) * 1_000_000;
        if !curable {
            self.sensor_sound = now;
        } else if wait_us != 0 && now.micros_since(self.sensor_sound) >= wait_us {
            self.sensor_sound = now;
            self.parts.values.pending.sensor = true;
        }
    }

    /// With no SYNC on the bus the lower node-id makes it, the other one if that fails (2050h).
    fn look_for_sync(&mut self, now: Instant) {
        let parameters = &self.parts.values.parameters;
        if self.parts.values.state != State::Operational {
            // A node that is stopped or being set up makes no SYNC of its own accord.
            self.parts.pair.excuse_sync(now);
            return self.end_standing_in(now);
        }
        let first = self.bus.node_id() < parameters.peer;
        let patience_ms = i64::from(parameters.fallback_ms) * if first { 1 } else { 2 };
        let silent_us = now.micros_since(self.parts.pair.last_sync());
        if patience_ms == 0 || silent_us <= patience_ms * 1000 {
            return;
        }
        self.parts.values.process.source = SyncSource::None;
        if !self.sync_substituted {
            self.sync_substituted = true;
            let period_us = Some(parameters.fallback_period_us);
            self.bus.stand_in_for_sync(period_us, now);
        }
    }

    /// What is wrong with this channel and its memory. What is wrong with the pair is derived
    /// whenever it is reported.
    fn look_for_faults(&mut self, now: Instant) {
        let mut found = Faults::default();
        found.of_reading(&self.parts.values.process.measured);
        if I::PRESETS {
            self.look_at_range(&mut found, now);
        }
        let temperature = self.parts.channel.temperature();
        let beyond = temperature.is_some_and(|t| !(COLDEST..=HOTTEST).contains(&t.0));
        found.set(Fault::Temperature, beyond);
        found.set(Fault::NotCalibrated, !self.parts.values.calibrated);
        let corrupt = self.parts.channel.fault() == Some(Invalid::Corrupt);
        found.set(Fault::CalibrationRecord, self.record_damaged || corrupt);
        found.set(Fault::Storage, self.parts.values.storage_failed);
        found.set(Fault::Program, self.parts.values.program_damaged);
        self.looked = found;
    }

    /// Whether slopes are outside the measuring range (2040h).
    fn look_at_range(&self, found: &mut Faults, now: Instant) {
        let shown = self.shown(now);
        let [x, y] = [0, 1].map(|axis| shown.slope(axis));
        let [low_x, high_x, low_y, high_y] = self.parts.values.parameters.range;
        for (fault, slope, low, high) in [
            (Fault::RangeX, x, low_x, high_x),
            (Fault::RangeY, y, low_y, high_y),
        ] {
            let stood = self.faults.has(fault);
            found.set(fault, slope.is_some_and(|a| outside(a, low, high, stood)));
        }
    }

    /// Everything that is wrong now.
    fn found(&self, judgement: Option<Judgement>, now: Instant) -> Faults {
        let mut found = self.looked;
        if let Some(judgement) = judgement {
            found.of_judgement(judgement);
        }
        if self.parts.pair.disagree() && judgement != Some(Judgement::PhysicalFault) {
            found.insert(Fault::Disagree);
        }
        if self.parts.values.pending.fail_safe {
            found.insert(Fault::FailSafe);
        }
        found.set(Fault::Unlike, self.shown(now).is_unlike());
        found
    }

    /// Tells the bus what has appeared and what has gone, and withdraws consent to SRDOs; true
    /// when that is something new.
    pub(super) fn report(&mut self, now: Instant) -> bool {
        let judgement = self.parts.pair.judgement(now);
        if self.judged != judgement {
            self.judged = judgement;
            self.parts.values.process.since_ms = self.uptime_ms(now);
        }
        let (before, found) = (self.faults, self.found(judgement, now));
        let has_changed_faults = before != found;
        if has_changed_faults {
            self.faults = found;
            for fault in found.new_since(before).iter() {
                self.tell(Some(fault.report().0), found, now);
                self.write_down(Some(fault), now);
            }
            if !before.new_since(found).is_empty() {
                self.tell(None, found, now);
                self.write_down(None, now);
            }
        }
        let consent = self.consents(now);
        let changed = self.bus.consent_to_safety(consent);
        if changed && consent.is_none() {
            self.matching.sending.withhold_safety();
        }
        changed || has_changed_faults
    }

    /// EMCY: the set of faults in its bytes 3 to 5, who is blamed and why in byte 6, and the
    /// state of the pair in byte 7.
    fn tell(&mut self, code: Option<u16>, found: Faults, now: Instant) {
        let [a, b, c, _] = found.bits().to_le_bytes();
        let (state, (blamed, why)) = self.shown(now).finding();
        let detail = [a, b, c, blamed << 6 | why & 0x3F, state];
        let bits = found.register();
        let (bus, mut objects) = self.split(now);
        match code {
            Some(code) => bus.report(&mut objects, code, bits, detail, now),
            None => bus.cleared(bits, detail),
        }
    }

    /// An event for the log; a new fault keeps the samples around it.
    fn write_down(&mut self, fault: Option<Fault>, now: Instant) {
        if !I::HISTORY {
            return;
        }
        let keeps_samples = fault.is_some_and(Fault::keeps_samples);
        let code = fault.map_or(0, |fault| fault.report().0);
        let (state, (blamed, reason)) = self.shown(now).finding();
        let mut entry = Entry {
            at_ms: self.uptime_ms(now),
            sync: self.parts.values.process.syncs,
            code,
            faults: self.faults.bits(),
            state,
            blamed,
            reason,
            ..Entry::default()
        };
        if !self.parts.log.add(entry) || !keeps_samples {
            return;
        }
        entry.box_number = self.parts.black_box.trigger(entry, now);
        self.parts.log.in_box(entry.box_number);
    }

    /// A safety frame is sent only of an angle that is valid, checked and configured as signed:
    /// when it was checked.
    fn consents(&self, now: Instant) -> Option<Instant> {
        if !I::SERVICES.safety {
            return None;
        }
        let signed = self.parts.values.parameters.safety_valid == VALID;
        // What is asked most often, and mostly decides, comes first.
        if !signed || self.faults.forbid_safety() {
            return None;
        }
        let sound = self.shown(now).measured(0).is_some();
        self.parts.pair.agreed_at().filter(|_| sound)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(degrees: f64, stood: bool) -> bool {
        outside(Angle::from_degrees(degrees), -90_000, 90_000, stood)
    }

    #[test]
    fn noise_at_the_end_of_the_range_made_an_emergency_of_each_sample() {
        assert!(!at(89.99, false) && at(90.01, false));
        assert!(at(89.99, true) && at(-89.81, true));
        assert!(!at(89.79, true) && !at(-89.79, true));
        // A narrow range has its middle.
        let narrow = |degrees| outside(Angle::from_degrees(degrees), 0, 100, true);
        assert!(narrow(0.01) && !narrow(0.05) && narrow(0.09));
        // The full circle has no end.
        for degrees in [-180.0, 0.0, 179.999] {
            let circle = outside(Angle::from_degrees(degrees), -180_000, 180_000, false);
            assert!(!circle, "{degrees}");
        }
    }
}
