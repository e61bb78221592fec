//! Intel HEX, which every programmer's software takes (Intel, "Hexadecimal Object File Format").
//!
//! In: bytes and their address. Out: text of data records, 16 bytes each, under extended linear
//! addresses. Records of nothing but FFh are left out: that is what an erased flash holds.

use std::fmt::Write;

/// One record: its type, its 16 bits of address, its bytes and their check sum.
fn record(text: &mut String, kind: u8, address: u16, bytes: &[u8]) {
    let [high, low] = address.to_be_bytes();
    let head = [bytes.len() as u8, high, low, kind];
    let all = head.iter().chain(bytes);
    let sum = all.clone().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
    text.push(':');
    for byte in all.chain([&sum.wrapping_neg()]) {
        // Writing to a string cannot fail.
        let _ = write!(text, "{byte:02X}");
    }
    text.push('\n');
}

/// `bytes` at `address`, a multiple of 16.
pub fn encode(address: u32, bytes: &[u8]) -> String {
    let mut text = String::new();
    let mut upper = None;
    for (at, piece) in (address..).step_by(16).zip(bytes.chunks(16)) {
        if piece.iter().all(|byte| *byte == u8::MAX) {
            continue;
        }
        let here = (at >> 16) as u16;
        if upper.replace(here) != Some(here) {
            record(&mut text, 4, 0, &here.to_be_bytes());
        }
        record(&mut text, 0, at as u16, piece);
    }
    record(&mut text, 1, 0, &[]);
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_are_as_the_format_has_them() {
        let mut bytes = vec![0xFF; 48];
        bytes[..4].copy_from_slice(&[0, 0x50, 0, 0x20]);
        bytes[32..].fill(0x11);
        let expected = ":020000040800F2\n\
            :10FFE00000500020FFFFFFFFFFFFFFFFFFFFFFFFAD\n\
            :020000040801F1\n\
            :1000000011111111111111111111111111111111E0\n\
            :00000001FF\n";
        assert_eq!(encode(0x0800_FFE0, &bytes), expected);
    }
}
