//! Block upload in conversation.

use super::*;

#[test]
fn nine_bytes_go_in_one_block() {
    Bench::with(TEXT, b"123456789").talk(
        "c A4 04 20 00 7F
         s C6 04 20 00 09
         c A3
         s 01 31 32 33 34 35 36 37
         s 82 38 39
         s -
         c A2 02 7F
         s D5 C3 31
         c A1
         s -
         c A1
         s 80 00 00 00 01 00 04 05",
    );
}

#[test]
fn without_check_sum_its_field_is_zero() {
    Bench::with(TEXT, b"123456789").talk(
        "c A0 04 20 00 7F
         s C6 04 20 00 09
         c A3
         s 01 31 32 33 34 35 36 37
         s 82 38 39
         c A2 02 7F
         s D5
         c A1",
    );
}

#[test]
fn a_number_goes_in_a_block_like_anything_else() {
    Bench::new().talk(
        "c A0 00 20 00 7F
         s C6 00 20 00 01
         c A3
         s 81 2A
         c A2 01 7F
         s D9
         c A1",
    );
}

#[test]
fn crc_wrong_for_lengths_that_are_multiples_of_7() {
    for length in [7, 14, 21, 889, 896] {
        let content = pattern(length);
        let mut bench = Bench::with(IMAGE, &content);
        bench.send(&frame("A4 08 20 01 7F"));
        bench.receive();
        bench.send(&frame("A3"));
        let mut got = Vec::new();
        while let Some([number, data @ ..]) = bench.receive() {
            got.extend(data);
            if !bench.server.is_pending() {
                bench.send(&[0xA2, number & 0x7F, 127, 0, 0, 0, 0, 0]);
            }
            if number & 0x80 != 0 {
                break;
            }
        }
        assert_eq!(got, content);
        let [low, high] = crate::crc::update(0, &content).to_le_bytes();
        assert_eq!(bench.receive(), Some([0xC1, low, high, 0, 0, 0, 0, 0]));
        bench.talk("c A1\n s -");
    }
}

#[test]
fn blksize_0() {
    let mut bench = Bench::with(TEXT, b"123456789");
    bench.talk(
        "c A4 04 20 00 00
         s 80 04 20 00 02 00 04 05
         c A4 04 20 00 80
         s 80 04 20 00 02 00 04 05
         c A4 04 20 00 01
         s C6 04 20 00 09
         c A3
         s 01 31 32 33 34 35 36 37
         c A2 01 00
         s 80 04 20 00 02 00 04 05",
    );
    bench.assert_usable();
}

#[test]
fn empty_string() {
    Bench::new().talk(
        "c A4 04 20 00 7F
         s C6 04 20 00 00
         c A3
         s 81
         c A2 00 7F
         s 81
         c A2 01 7F
         s DD
         c A1",
    );
}

#[test]
fn a_client_that_allows_it_gets_a_short_object_by_a_normal_upload() {
    Bench::with(TEXT, b"123456789").talk(
        "c A4 00 20 00 7F 01
         s 4F 00 20 00 2A
         c A4 04 20 00 7F 09
         s 41 04 20 00 09
         c 60
         s 00 31 32 33 34 35 36 37
         c 70
         s 1B 38 39
         c A4 04 20 00 7F 08
         s C6 04 20 00 09
         c 80",
    );
}

#[test]
fn each_block_has_the_size_last_asked_for() {
    Bench::with(TEXT, b"aaaaaaabbbbbbbcccccccdddddddeeeeeee").talk(
        "c A0 04 20 00 02
         s C6 04 20 00 23
         c A3
         s 01 61 61 61 61 61 61 61
         s 02 62 62 62 62 62 62 62
         s -
         c A2 02 01
         s 01 63 63 63 63 63 63 63
         s -
         c A2 01 7F
         s 01 64 64 64 64 64 64 64
         s 82 65 65 65 65 65 65 65
         s -
         c A2 02 00
         s C1
         c A1",
    );
}

#[test]
fn second_retransmit_request() {
    Bench::with(TEXT, b"aaaaaaabbbbbbbc").talk(
        "c A4 04 20 00 7F
         s C6 04 20 00 0F
         c A3
         s 01 61 61 61 61 61 61 61
         s 02 62 62 62 62 62 62 62
         s 83 63
         c A2 01 7F
         s 01 62 62 62 62 62 62 62
         s 82 63
         c A2 00 7F
         s 01 62 62 62 62 62 62 62
         s 82 63
         c A2 01 7F
         s 81 63
         c A2 00 01
         s 81 63
         c A2 01 01
         s D9 D0 7F
         c A1",
    );
}

#[test]
fn a_client_need_not_wait_for_the_whole_block() {
    Bench::with(TEXT, b"aaaaaaabbbbbbbc").talk(
        "c A0 04 20 00 7F
         s C6 04 20 00 0F
         c A3
         C A2 01 7F
         s 01 61 61 61 61 61 61 61
         C A2 01 7F
         s 01 62 62 62 62 62 62 62
         s 82 63
         c A2 02 7F
         s D9
         c A1",
    );
}

#[test]
fn an_acknowledgement_of_what_was_not_sent_ends_the_transfer() {
    let mut bench = Bench::with(TEXT, b"123456789");
    bench.talk(
        "c A0 04 20 00 7F
         s C6 04 20 00 09
         c A3
         s 01 31 32 33 34 35 36 37
         s 82 38 39
         c A2 03 7F
         s 80 04 20 00 03 00 04 05",
    );
    bench.assert_usable();
}

#[test]
fn client_abort_in_the_middle() {
    let steps = [
        "c A0 04 20 00 01\n s C6 04 20 00 09",
        "c A3\n s 01 31 32 33 34 35 36 37",
        "c A2 01 01\n s 81 38 39",
        "c A2 01 01\n s D5",
    ];
    for until in 1..=steps.len() {
        let mut bench = Bench::with(TEXT, b"123456789");
        for step in steps.iter().take(until) {
            bench.talk(step);
        }
        bench.talk("c 80 04 20 00 00 00 00 08\n s -");
        bench.assert_usable();
    }
    // While segments are still on their way.
    let mut bench = Bench::with(TEXT, b"123456789");
    bench.talk("c A0 04 20 00 7F\n s C6 04 20 00 09\n c A3\n C 80\n s -");
    bench.assert_usable();
}

#[test]
fn requests_out_of_place_end_the_transfer() {
    let mut bench = Bench::with(TEXT, b"123456789");
    for request in ["A1", "A2 00 7F", "60", "00", "C1"] {
        bench.talk("c A0 04 20 00 7F\n s C6 04 20 00 09");
        bench.send(&frame(request));
        bench.talk("s 80 04 20 00 01 00 04 05");
    }
    bench.talk("c A0 04 20 00 7F\n s C6 04 20 00 09");
    bench.assert_usable();
    bench.talk("c A3\n s 80 00 00 00 01 00 04 05");
}

#[test]
fn an_object_that_shrinks_while_it_is_read_ends_the_transfer() {
    let mut bench = Bench::with(TEXT, b"123456789");
    bench.talk("c A0 04 20 00 7F\n s C6 04 20 00 09");
    bench.objects.streams.insert(TEXT, b"1".to_vec());
    bench.talk("c A3\n s 80 04 20 00 20 00 00 08\n s -");
}

#[test]
fn a_busy_bus_is_no_silent_client() {
    let mut bench = Bench::with(TEXT, &pattern(21));
    bench.talk("c A0 04 20 00 7F\n s C6 04 20 00 15");
    bench.send(&frame("A3"));
    for _ in 0..3 {
        assert!(bench.wait_ms(2000).is_some());
        assert!(
            bench
                .receive()
                .is_some_and(|[number, ..]| number & 0x7F < 4)
        );
    }
    assert!(bench.wait_ms(2000).is_some());
    bench.talk("c A2 03 7F\n s C1\n c A1");
}

#[test]
fn a_silent_client_loses_its_transfer() {
    let mut bench = Bench::with(TEXT, b"123456789");
    bench.talk("c A0 04 20 00 01\n s C6 04 20 00 09\n c A3\n s 01 31 32 33 34 35 36 37");
    assert!(bench.wait_ms(2999).is_some());
    assert_eq!(bench.wait_ms(1), None);
    bench.talk("s 80 04 20 00 00 00 04 05");
}
