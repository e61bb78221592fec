//! Bit rates as the CAN controller wants them (RM0008 24.7.7 and 24.9.2, CAN_BTR).
//!
//! In: a rate of CiA 301 in kbit/s. Out: the register's bits for a controller clock of 36 MHz.
//! Each bit has 18 or 9 time quanta with its sample point at 88.9 %, between the 85 % and 90 % that
//! all nodes of a CANopen bus share (CiA 301, table 1), and a jump width of 1.
//!
//! Left out: silent and loop-back mode, which are other bits of the same register.

/// The controller's clock, kHz: APB1.
const CLOCK_KHZ: u32 = 36_000;

/// CAN_BTR for a rate, kbit/s; `None` for a rate that CiA 301 does not have.
pub const fn register(kbit_s: u16) -> Option<u32> {
    let quanta = match kbit_s {
        10 | 20 | 50 | 125 | 250 | 500 | 1000 => 18,
        800 => 9,
        _ => return None,
    };
    let prescaler = CLOCK_KHZ / (kbit_s as u32 * quanta);
    // One quantum is the synchronisation segment, an eighth or ninth comes after the sample.
    let (before, after) = if quanta == 18 { (15, 2) } else { (7, 1) };
    Some((after - 1) << 20 | (before - 1) << 16 | (prescaler - 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use device::bit_rate::CANDIDATES;

    #[test]
    fn every_rate_that_is_looked_for_is_met_exactly_and_sampled_at_the_right_place() {
        for rate in CANDIDATES {
            let bits = register(rate).unwrap();
            let prescaler = (bits & 0x3FF) + 1;
            let before = (bits >> 16 & 0xF) + 2;
            let quanta = before + (bits >> 20 & 0x7) + 1;
            assert_eq!(u32::from(rate) * prescaler * quanta, CLOCK_KHZ, "{rate}");
            let sample_per_mille = before * 1000 / quanta;
            assert!((850..=900).contains(&sample_per_mille), "{rate}");
        }
    }

    #[test]
    fn other_rates_have_no_bits() {
        assert_eq!([register(0), register(83), register(2000)], [None; 3]);
    }
}
