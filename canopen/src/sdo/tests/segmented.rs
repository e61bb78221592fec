//! Segmented transfers in both directions.

use super::*;

#[test]
fn a_text_is_read_in_segments() {
    Bench::with(TEXT, b"inclinometer").talk(
        "c 40 04 20 00
         s 41 04 20 00 0C
         c 60
         s 00 69 6E 63 6C 69 6E 6F
         c 70
         s 15 6D 65 74 65 72
         c 60
         s 80 00 00 00 01 00 04 05",
    );
}

#[test]
fn a_text_of_two_full_segments_has_no_third() {
    Bench::with(TEXT, b"aaaaaaabbbbbbb").talk(
        "c 40 04 20 00
         s 41 04 20 00 0E
         c 60
         s 00 61 61 61 61 61 61 61
         c 70
         s 11 62 62 62 62 62 62 62",
    );
}

#[test]
fn empty_string() {
    Bench::new().talk("c 40 04 20 00\n s 41 04 20 00 00\n c 60\n s 0F");
}

#[test]
fn a_number_of_eight_bytes_takes_two_segments() {
    let mut bench = Bench::new();
    bench.talk(
        "c 40 02 20 00
         s 41 02 20 00 08
         c 60
         s 00 01 02 03 04 05 06 07
         c 70
         s 1D 08
         c 21 02 20 00 08
         s 60 02 20 00
         c 00 11 12 13 14 15 16 17
         s 20
         c 1D 18
         s 30",
    );
    let expected = Value::cut(0x1817_1615_1413_1211, 8);
    assert_eq!(bench.objects.values[&WIDE], expected);
}

#[test]
fn a_number_may_come_in_a_segment_without_its_size() {
    let mut bench = Bench::new();
    bench.talk("c 20 00 20 00\n s 60 00 20 00\n c 0D 09\n s 20");
    assert_eq!(bench.objects.values[&BYTE], Value::u8(9));
}

#[test]
fn a_text_is_written_in_segments_of_any_filling() {
    let mut bench = Bench::new();
    bench.talk(
        "c 20 04 20 00
         s 60 04 20 00
         c 00 61 62 63 64 65 66 67
         s 20
         c 1A 68 69
         s 30
         c 0D 6A
         s 20",
    );
    assert_eq!(bench.objects.stream(TEXT), b"abcdefghij");
    assert_eq!(bench.objects.announced, [None]);
}

#[test]
fn zero_length_download() {
    let mut bench = Bench::with(TEXT, b"old");
    bench.talk("c 21 04 20 00 00\n s 60 04 20 00\n c 0F\n s 20");
    assert_eq!(bench.objects.stream(TEXT), b"");
    assert_eq!(bench.objects.announced, [Some(0)]);
    bench.talk_in_vain("c 21 00 20 00 00\n s 80 00 20 00 13 00 07 06");
    bench.talk_in_vain("c 20 00 20 00\n s 60 00 20 00\n c 0F\n s 80 00 20 00 13 00 07 06");
}

#[test]
fn a_size_that_is_not_the_types_is_refused_at_once() {
    Bench::new().talk_in_vain(
        "c 21 00 20 00 02
         s 80 00 20 00 12 00 07 06
         c 21 02 20 00 07
         s 80 02 20 00 13 00 07 06
         c 21 02 20 00 FF FF FF FF
         s 80 02 20 00 12 00 07 06",
    );
}

#[test]
fn more_or_less_than_announced_is_refused() {
    let mut bench = Bench::with(TEXT, b"old");
    bench.talk_in_vain(
        "c 21 04 20 00 08
         s 60 04 20 00
         c 01 61 62 63 64 65 66 67
         s 80 04 20 00 10 00 07 06
         c 21 04 20 00 04
         s 60 04 20 00
         c 00 61 62 63 64 65 66 67
         s 80 04 20 00 10 00 07 06
         c 21 04 20 00 08
         s 60 04 20 00
         c 00 61 62 63 64 65 66 67
         s 20
         c 1B 68 69
         s 80 04 20 00 10 00 07 06",
    );
    assert_eq!(bench.objects.discards, 3);
}

#[test]
fn more_than_any_number_is_refused() {
    Bench::new().talk_in_vain(
        "c 20 02 20 00
         s 60 02 20 00
         c 00 01 02 03 04 05 06 07
         s 20
         c 10 08 09 0A 0B 0C 0D 0E
         s 80 02 20 00 12 00 07 06
         c 20 00 20 00
         s 60 00 20 00
         c 0B 01 02
         s 80 00 20 00 12 00 07 06",
    );
}

#[test]
fn a_toggle_bit_that_does_not_alternate_ends_the_transfer() {
    let mut bench = Bench::with(TEXT, b"inclinometer");
    bench.talk_in_vain(
        "c 40 04 20 00
         s 41 04 20 00 0C
         c 70
         s 80 04 20 00 00 00 03 05
         c 40 04 20 00
         s 41 04 20 00 0C
         c 60
         s 00 69 6E 63 6C 69 6E 6F
         c 60
         s 80 04 20 00 00 00 03 05
         c 21 04 20 00 09
         s 60 04 20 00
         c 00 61 62 63 64 65 66 67
         s 20
         c 0B 68 69
         s 80 04 20 00 00 00 03 05",
    );
    bench.assert_usable();
}

#[test]
fn client_abort_in_the_middle() {
    let mut bench = Bench::with(TEXT, b"inclinometer");
    bench.talk_in_vain(
        "c 21 04 20 00 09
         s 60 04 20 00
         c 00 61 62 63 64 65 66 67
         s 20
         c 80 04 20 00 00 00 00 08
         s -
         c 40 04 20 00
         s 41 04 20 00 0C
         c 80 04 20 00 00 00 00 08
         s -
         c 60
         s 80 00 00 00 01 00 04 05",
    );
    assert_eq!(bench.objects.discards, 1);
}

#[test]
fn a_new_transfer_takes_the_place_of_the_open_one() {
    let mut bench = Bench::with(TEXT, b"inclinometer");
    bench.talk(
        "c 21 04 20 00 09
         s 60 04 20 00
         c 00 61 62 63 64 65 66 67
         s 20
         c 40 04 20 00
         s 41 04 20 00 0C
         c 2F 00 20 00 07
         s 60 00 20 00
         c 60
         s 80 00 00 00 01 00 04 05",
    );
    assert_eq!(bench.objects.stream(TEXT), b"inclinometer");
    assert_eq!(bench.objects.discards, 1);
}

#[test]
fn an_unknown_command_ends_the_open_transfer() {
    let mut bench = Bench::with(TEXT, b"old");
    bench.talk_in_vain(
        "c 21 04 20 00 09
         s 60 04 20 00
         c 60
         s 80 04 20 00 01 00 04 05
         c 21 04 20 00 09
         s 60 04 20 00
         c E0
         s 80 04 20 00 01 00 04 05",
    );
    assert_eq!(bench.objects.discards, 2);
}

#[test]
fn an_object_that_refuses_bytes_is_left_as_it_was() {
    let mut bench = Bench::with(TEXT, b"old");
    bench.objects.refusal = Some(Abort::OutOfMemory);
    bench.talk_in_vain("c 20 04 20 00\n s 60 04 20 00\n c 0D 61\n s 80 04 20 00 05 00 04 05");
    bench.talk_in_vain("c 20 04 20 00\n s 60 04 20 00\n c 0F\n s 80 04 20 00 05 00 04 05");
    assert_eq!(bench.objects.discards, 2);
}

#[test]
fn an_object_that_shrinks_while_it_is_read_is_not_sent() {
    let mut bench = Bench::with(TEXT, b"inclinometer");
    bench.talk("c 40 04 20 00\n s 41 04 20 00 0C");
    bench.objects.streams.insert(TEXT, b"inc".to_vec());
    bench.talk("c 60\n s 80 04 20 00 20 00 00 08");
}
