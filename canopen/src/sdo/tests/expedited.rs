//! Transfers in one exchange, access, limits, aborts and time-outs.

use super::*;

#[test]
fn a_number_is_read_in_one_exchange() {
    let mut bench = Bench::new();
    bench.talk(
        "c 40 00 10 00
         s 43 00 10 00 9A 01 04 00
         c 40 00 20 00
         s 4F 00 20 00 2A
         c 40 03 20 00
         s 4B 03 20 00 FB FF",
    );
}

#[test]
fn boolean_unreadable() {
    Bench::new().talk("c 40 01 20 00\n s 4F 01 20 00 01");
}

#[test]
fn a_short_text_is_read_in_one_exchange() {
    Bench::with(TEXT, b"abc").talk("c 40 04 20 00\n s 47 04 20 00 61 62 63");
    Bench::with(TEXT, b"abcd").talk("c 40 04 20 00\n s 43 04 20 00 61 62 63 64");
}

#[test]
fn a_number_is_written_with_and_without_its_size() {
    let mut bench = Bench::new();
    bench.talk("c 2F 00 20 00 07\n s 60 00 20 00");
    assert_eq!(bench.objects.values[&BYTE], Value::u8(7));
    // The bytes behind the value may be anything.
    bench.talk("c 22 00 20 00 08 FF FF FF\n s 60 00 20 00");
    assert_eq!(bench.objects.values[&BYTE], Value::u8(8));
    bench.talk("c 23 05 20 00 01 02 03 04\n s 60 05 20 00");
    assert_eq!(bench.objects.values[&SECRET], Value::u32(0x0403_0201));
}

#[test]
fn a_text_is_written_in_one_exchange() {
    let mut bench = Bench::new();
    bench.talk("c 2B 04 20 00 68 69\n s 60 04 20 00");
    assert_eq!(bench.objects.stream(TEXT), b"hi");
    assert_eq!(bench.objects.announced, [Some(2)]);
}

#[test]
fn what_does_not_exist_is_told_apart() {
    Bench::new().talk_in_vain(
        "c 40 00 30 00
         s 80 00 30 00 00 00 02 06
         c 40 00 20 01
         s 80 00 20 01 11 00 09 06
         c 2F 00 30 00 01
         s 80 00 30 00 00 00 02 06
         c C2 00 20 01 01
         s 80 00 20 01 11 00 09 06
         c A0 00 30 00 7F
         s 80 00 30 00 00 00 02 06",
    );
}

#[test]
fn access_comes_before_length() {
    Bench::new().talk_in_vain(
        "c 2F 00 10 00 01
         s 80 00 10 00 02 00 01 06
         c 40 05 20 00
         s 80 05 20 00 01 00 01 06
         c A0 05 20 00 7F
         s 80 05 20 00 01 00 01 06
         c 21 00 10 00 04
         s 80 00 10 00 02 00 01 06
         c C2 00 10 00 04
         s 80 00 10 00 02 00 01 06
         c 40 07 20 00
         s 80 07 20 00 00 00 01 06",
    );
}

#[test]
fn refused_write_changes_nothing() {
    let mut bench = Bench::new();
    bench.talk_in_vain(
        "c 2F 00 20 00 65
         s 80 00 20 00 31 00 09 06
         c 2B 03 20 00 9B FF
         s 80 03 20 00 32 00 09 06
         c 2F 01 20 00 02
         s 80 01 20 00 31 00 09 06
         c 2B 00 20 00 01
         s 80 00 20 00 12 00 07 06
         c 2F 03 20 00 01
         s 80 03 20 00 13 00 07 06
         c 22 02 20 00 01
         s 80 02 20 00 13 00 07 06",
    );
    bench.objects.refusal = Some(Abort::WrongState);
    bench.talk_in_vain(
        "c 2F 00 20 00 01
         s 80 00 20 00 22 00 00 08
         c 2F 04 20 00 61
         s 80 04 20 00 22 00 00 08",
    );
    assert_eq!(bench.objects.discards, 1);
}

#[test]
fn an_object_without_a_value_is_answered_with_no_data() {
    Bench::new().talk("c 2F 00 20 00 01\n s 60 00 20 00");
    let mut bench = Bench::default();
    bench.talk("c 40 00 20 00\n s 80 00 20 00 24 00 00 08");
}

#[test]
fn aborts_answered_with_aborts() {
    let mut bench = Bench::new();
    bench.talk("c 80 00 20 00 00 00 04 05\n s -");
    bench.talk("c 9F FF FF FF FF FF FF FF\n s -");
    bench.assert_usable();
}

#[test]
fn a_client_abort_withdraws_the_answer() {
    Bench::new().talk("c 40 00 20 00\n C 80 00 20 00 00 00 04 05\n s -");
}

#[test]
fn an_unknown_command_is_refused() {
    Bench::new().talk(
        "c E0 00 20 00
         s 80 00 00 00 01 00 04 05
         c 00 61 62 63
         s 80 00 00 00 01 00 04 05
         c 60
         s 80 00 00 00 01 00 04 05
         c A1
         s 80 00 00 00 01 00 04 05
         c A2 01 7F
         s 80 00 00 00 01 00 04 05
         c A3
         s 80 00 00 00 01 00 04 05
         c C1
         s 80 00 00 00 01 00 04 05",
    );
}

#[test]
fn a_frame_of_fewer_than_eight_bytes_is_no_request() {
    let mut bench = Bench::new();
    bench.send(&[0x40, 0x00, 0x10, 0x00]);
    bench.send(&[]);
    let remote = Frame::remote(crate::frame::standard(0x605), 8).unwrap();
    bench.server.request(&mut bench.objects, &remote, bench.now);
    assert!(!bench.server.is_pending());
    bench.assert_usable();
}

#[test]
fn segment_time_out_of_25_ms() {
    let mut bench = Bench::new();
    bench.talk("c 21 04 20 00 02\n s 60 04 20 00");
    let deadline = Instant(3_000_000);
    assert_eq!(bench.wait_ms(25), Some(deadline));
    assert_eq!(bench.wait_ms(2974), Some(deadline));
    assert_eq!(bench.receive(), None);
    bench.talk("c 0B 68 69\n s 20");
    assert_eq!(bench.objects.stream(TEXT), b"hi");
    assert_eq!(bench.wait_ms(10_000), None);
    assert_eq!(bench.receive(), None);
}

#[test]
fn a_slow_client_keeps_its_transfer() {
    let mut bench = Bench::new();
    bench.talk("c 20 04 20 00\n s 60 04 20 00");
    for segment in ["c 0C 61\n s 20", "c 1C 62\n s 30", "c 0D 63\n s 20"] {
        assert!(bench.wait_ms(2900).is_some());
        bench.talk(segment);
    }
    assert_eq!(bench.objects.stream(TEXT), b"abc");
    // Inside a block the client alone speaks.
    bench.talk("c C0 04 20 00\n s A4 04 20 00 7F");
    for segment in ["c 01 61", "c 02 62", "c 83 63\n s A2 03 7F"] {
        assert!(bench.wait_ms(2900).is_some());
        bench.talk(segment);
    }
}

#[test]
fn a_silent_client_loses_its_transfer_after_three_seconds() {
    let mut bench = Bench::new();
    bench.talk("c 21 04 20 00 02\n s 60 04 20 00");
    assert_eq!(bench.wait_ms(3000), None);
    bench.talk("s 80 04 20 00 00 00 04 05\n s -");
    assert_eq!((bench.objects.discards, &bench.objects.sink), (1, &None));
    bench.assert_usable();
}

#[test]
fn a_reset_forgets_the_transfer_in_silence() {
    let mut bench = Bench::new();
    bench.send(&frame("21 04 20 00 02"));
    bench.server.reset(&mut bench.objects);
    bench.talk("s -");
    assert_eq!(bench.objects.discards, 1);
    bench.talk("c 0B 68 69\n s 80 00 00 00 01 00 04 05");
    bench.assert_usable();
}
