//! Block download in conversation.

use super::*;

/// The end of a block download of `bytes`.
fn end(unused: u8, bytes: &[u8]) -> [u8; 8] {
    let [low, high] = crate::crc::update(0, bytes).to_le_bytes();
    [0xC1 | unused << 2, low, high, 0, 0, 0, 0, 0]
}

#[test]
fn nine_bytes_come_in_one_block() {
    let mut bench = Bench::new();
    bench.talk(
        "c C6 04 20 00 09
         s A4 04 20 00 7F
         c 01 61 62 63 64 65 66 67
         s -
         c 82 68 69
         s A2 02 7F",
    );
    assert_eq!(bench.objects.stream(TEXT), b"");
    bench.send(&end(5, b"abcdefghi"));
    bench.talk("s A1");
    assert_eq!(bench.objects.stream(TEXT), b"abcdefghi");
    assert_eq!(bench.objects.announced, [Some(9)]);
    bench.assert_usable();
}

#[test]
fn neither_size_nor_check_sum_is_needed() {
    let mut bench = Bench::new();
    bench.talk(
        "c C0 04 20 00
         s A4 04 20 00 7F
         c 81 61 62 63 64 65 66 67
         s A2 01 7F
         c C1
         s A1",
    );
    assert_eq!(bench.objects.stream(TEXT), b"abcdefg");
    assert_eq!(bench.objects.announced, [None]);
}

#[test]
fn a_wrong_check_sum_leaves_the_object_as_it_was() {
    let mut bench = Bench::with(TEXT, b"old");
    bench.talk_in_vain(
        "c C6 04 20 00 01
         s A4 04 20 00 7F
         c 81 61
         s A2 01 7F
         c D9 34 12
         s 80 04 20 00 04 00 04 05",
    );
    assert_eq!(bench.objects.discards, 1);
    bench.assert_usable();
}

#[test]
fn a_number_comes_in_a_block_like_anything_else() {
    let mut bench = Bench::new();
    bench.talk(
        "c C2 00 20 00 01
         s A4 00 20 00 7F
         c 81 07
         s A2 01 7F
         c D9
         s A1
         c C0 02 20 00
         s A4 02 20 00 7F
         c 01 11 12 13 14 15 16 17
         c 82 18
         s A2 02 7F
         c D9
         s A1",
    );
    assert_eq!(bench.objects.values[&BYTE], Value::u8(7));
    let expected = Value::cut(0x1817_1615_1413_1211, 8);
    assert_eq!(bench.objects.values[&WIDE], expected);
}

#[test]
fn a_number_of_the_wrong_length_or_value_is_refused() {
    Bench::new().talk_in_vain(
        "c C2 00 20 00 02
         s 80 00 20 00 12 00 07 06
         c C0 00 20 00
         s A4 00 20 00 7F
         c 81 07 07
         s A2 01 7F
         c D5
         s 80 00 20 00 12 00 07 06
         c C0 00 20 00
         s A4 00 20 00 7F
         c 81 65
         s A2 01 7F
         c D9
         s 80 00 20 00 31 00 09 06",
    );
}

#[test]
fn zero_length_download() {
    for segments in ["c 81\n s A2 01 7F\n", ""] {
        let mut bench = Bench::with(TEXT, b"old");
        bench.talk("c C6 04 20 00 00\n s A4 04 20 00 7F");
        bench.talk(segments);
        bench.talk("c DD\n s A1");
        assert_eq!(bench.objects.stream(TEXT), b"");
    }
}

#[test]
fn a_gap_is_told_and_the_client_goes_on_behind_it() {
    let mut bench = Bench::new();
    bench.talk(
        "c C0 04 20 00
         s A4 04 20 00 7F
         c 01 61 61 61 61 61 61 61
         c 03 63 63 63 63 63 63 63
         c 84 64
         s A2 01 7F
         c 01 62 62 62 62 62 62 62
         c 02 63 63 63 63 63 63 63
         c 83 64
         s A2 03 7F
         c D9
         s A1",
    );
    assert_eq!(bench.objects.stream(TEXT), b"aaaaaaabbbbbbbcccccccd");
}

#[test]
fn nothing_in_order_is_told_as_zero() {
    Bench::new().talk_in_vain(
        "c C0 04 20 00
         s A4 04 20 00 7F
         c 82 61
         s A2 00 7F
         c FF 61
         s A2 00 7F
         c 80 04 20 00
         s -",
    );
}

#[test]
fn a_segment_that_comes_twice_counts_once() {
    let mut bench = Bench::new();
    bench.talk(
        "c C0 04 20 00
         s A4 04 20 00 7F
         c 01 61 61 61 61 61 61 61
         c 01 61 61 61 61 61 61 61
         c 82 62
         C 82 62
         s A2 02 7F
         c 82 62
         s -
         c D9
         s A1",
    );
    assert_eq!(bench.objects.stream(TEXT), b"aaaaaaab");
}

#[test]
fn a_first_request_that_comes_twice_is_answered_once() {
    Bench::new().talk_in_vain(
        "c C6 04 20 00 09
         C C6 04 20 00 09
         s A4 04 20 00 7F
         s -
         c 80",
    );
}

#[test]
fn a_block_of_127_segments_is_acknowledged_without_a_last_one() {
    let mut bench = Bench::new();
    let content = pattern(7 * 127 + 3);
    bench.talk("c C6 04 20 00 7C 03\n s A4 04 20 00 7F");
    for (number, bytes) in (1..).zip(content.chunks(7)) {
        let last = number == 128;
        let mut data = [if last { 0x81 } else { number as u8 }, 0, 0, 0, 0, 0, 0, 0];
        data[1..=bytes.len()].copy_from_slice(bytes);
        bench.send(&data);
        if number == 127 {
            bench.talk("s A2 7F 7F");
            bench.send(&data);
            bench.talk("s -");
        }
    }
    bench.talk("s A2 01 7F");
    bench.send(&end(4, &content));
    bench.talk("s A1");
    assert_eq!(bench.objects.stream(TEXT), content);
}

#[test]
fn more_or_less_than_announced_is_refused() {
    let mut bench = Bench::with(TEXT, b"old");
    bench.talk_in_vain(
        "c C2 04 20 00 02
         s A4 04 20 00 7F
         c 81 61 62 63
         s A2 01 7F
         c D1
         s 80 04 20 00 10 00 07 06
         c C2 04 20 00 04
         s A4 04 20 00 7F
         c 81 61 62 63
         s A2 01 7F
         c D1
         s 80 04 20 00 10 00 07 06",
    );
    assert_eq!(bench.objects.discards, 2);
}

/// The number of a segment can look like a request: 23h would write to the object that its bytes
/// name. An object that refuses in the middle of a block must not let that happen.
#[test]
fn segments_on_their_way_are_no_requests() {
    let mut bench = Bench::with(TEXT, b"old");
    bench.talk("c C0 04 20 00\n s A4 04 20 00 7F");
    bench.objects.refusal = Some(Abort::Hardware);
    for number in 1..0x23 {
        bench.send(&[number, 1, 1, 1, 1, 1, 1, 1]);
    }
    bench.objects.refusal = None;
    bench.talk_in_vain("c 23 05 20 00 01 02 03 04\n c A4\n s 80 04 20 00 00 00 06 06");
    bench.assert_usable();
}

#[test]
fn client_abort_in_the_middle() {
    for until in 1..4 {
        let mut bench = Bench::with(TEXT, b"old");
        let steps = [
            "c C0 04 20 00\n s A4 04 20 00 7F",
            "c 01 61",
            "c 82 61\n s A2 02 7F",
        ];
        for step in steps.iter().take(until) {
            bench.talk(step);
        }
        bench.talk_in_vain("c 80 04 20 00 00 00 00 08\n s -");
        assert_eq!(bench.objects.discards, 1);
        bench.assert_usable();
    }
}

#[test]
fn another_request_instead_of_the_end_is_served() {
    let mut bench = Bench::with(TEXT, b"old");
    bench.talk("c C0 04 20 00\n s A4 04 20 00 7F\n c 81 61\n s A2 01 7F");
    bench.assert_usable();
    assert_eq!(
        (bench.objects.stream(TEXT), bench.objects.discards),
        (&b"old"[..], 1)
    );
}

#[test]
fn a_segment_instead_of_the_end_ends_the_transfer() {
    Bench::with(TEXT, b"old").talk_in_vain(
        "c C0 04 20 00
         s A4 04 20 00 7F
         c 81 61
         s A2 01 7F
         c 01 62
         s 80 04 20 00 01 00 04 05",
    );
}

#[test]
fn a_silent_client_loses_its_transfer() {
    let mut bench = Bench::with(TEXT, b"old");
    bench.talk("c C0 04 20 00\n s A4 04 20 00 7F\n c 01 61");
    assert_eq!(bench.wait_ms(3000), None);
    bench.talk_in_vain("s 80 04 20 00 00 00 04 05");
    bench.assert_usable();
}
