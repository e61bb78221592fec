//! The words of a gyroscope in a calibration's bytes.
//!
//! In: a [`RateCorrection`], or words. Out: its 21 words, or the correction that they make, unless
//! it is none that a gyroscope in its housing can have ([`DecodeError::Rates`]).
//!
//! Left out: where these words stand, and which versions have them (`encoding`).

use tilt::composition::{Composition, Place};
use tilt::rate::RateCorrection;

use super::{DecodeError, Words};

/// How many words it is.
pub(super) const WORDS: usize = 9 + 4 * 3;

/// 20 deg/s, 2^-30 rad/s per step.
const BIAS: u32 = 374_806_603;

/// 0.1 (deg/s)/degC, 2^-38 rad/s per degC.
const BIAS1: u32 = 479_752_452;

/// 0.001 (deg/s)/degC^2, 2^-46 rad/s per degC^2.
const BIAS2: u32 = 1_228_166_276;

/// 0.1 %/degC, 2^-38 per degC.
const SCALE1: u32 = 274_877_907;

/// Hands over every number in order.
pub(super) fn put(rates: &RateCorrection, all: &mut dyn FnMut(&[i32])) {
    all(rates.matrix.as_flattened());
    for numbers in [
        &rates.scale1_q38,
        &rates.bias_q30,
        &rates.bias1_q38,
        &rates.bias2_q46,
    ] {
        all(numbers);
    }
}

/// Takes the next words for `rates`; without any (`told` is false) they are `None`.
///
/// Errors: see [`DecodeError`]; they are then worth nothing.
pub(super) fn fill<C: Composition>(
    words: &mut Words<'_, '_>,
    told: bool,
    rates: &mut Option<C::Rates>,
) -> Result<(), DecodeError> {
    *rates = None;
    if !told {
        return Ok(());
    }
    let blank = C::Rates::put(|| RateCorrection::IDENTITY).ok_or(DecodeError::NoGyroscope)?;
    let rates = rates.insert(blank).get_mut();
    words.fill(rates.matrix.as_flattened_mut())?;
    words.fill(&mut rates.scale1_q38)?;
    words.fill(&mut rates.bias_q30)?;
    words.fill(&mut rates.bias1_q38)?;
    words.fill(&mut rates.bias2_q46)?;
    match is_plausible(rates) {
        true => Ok(()),
        false => Err(DecodeError::Rates),
    }
}

fn is_plausible(rates: &RateCorrection) -> bool {
    let within = |numbers: &[i32; 3], limit| numbers.iter().all(|n| n.unsigned_abs() <= limit);
    rates.is_near_identity()
        && within(&rates.scale1_q38, SCALE1)
        && within(&rates.bias_q30, BIAS)
        && within(&rates.bias1_q38, BIAS1)
        && within(&rates.bias2_q46, BIAS2)
}
