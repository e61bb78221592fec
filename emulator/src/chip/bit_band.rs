//! The bit-band alias: one word for each bit of the peripherals and of the RAM.
//!
//! In: an address of the alias. Out: the byte and the bit behind it. Source: RM0008 3.3.2.
//! Left out: nothing; the chip does the load, and for a store the load before it.

/// Where the RAM's alias begins, and where that of the peripherals does.
const RAM_ALIAS: u32 = 0x2200_0000;
const PERIPHERAL_ALIAS: u32 = 0x4200_0000;
/// Size of either alias.
const SIZE: u32 = 0x0200_0000;

/// The byte and the bit of the RAM behind an address of its alias.
pub fn in_ram(address: u32) -> Option<(u32, u8)> {
    behind(address, RAM_ALIAS)
}

/// The byte and the bit of a peripheral's register behind an address of its alias.
pub fn in_peripherals(address: u32) -> Option<(u32, u8)> {
    behind(address, PERIPHERAL_ALIAS)
}

fn behind(address: u32, alias: u32) -> Option<(u32, u8)> {
    let offset = address.checked_sub(alias).filter(|at| *at < SIZE)?;
    let byte = alias - SIZE + offset / 32;
    Some((byte, (offset / 4 % 8) as u8))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_example_of_the_manual() {
        // RM0008 3.3.2: bit 2 of the byte at 2000 0300h is at 2200 6008h.
        assert_eq!(in_ram(0x2200_6008), Some((0x2000_0300, 2)));
        assert_eq!(in_peripherals(0x4242_0180), Some((0x4002_100C, 0)));
        assert_eq!(in_ram(0x4200_0000), None);
    }
}
