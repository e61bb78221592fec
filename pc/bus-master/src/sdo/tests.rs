//! Conversations with a fake server: what it is asked, what it answers, and what the client makes
//! of it.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::thread::{JoinHandle, spawn};

use super::*;
use crate::address::{self, BusAddress};

/// A bus whose other end sends to each request what `answers` has for it, as words of
/// socketcand; it returns the requests.
fn bus(answers: &'static [&'static str]) -> (Bus, JoinHandle<Vec<String>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = listener.local_addr().unwrap().to_string();
    let server = spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let words = BufReader::new(stream.try_clone().unwrap()).split(b'>');
        stream.write_all(b"< hi >").unwrap();
        let (mut requests, mut answers) = (Vec::new(), answers.iter());
        for word in words.map_while(Result::ok) {
            let word = String::from_utf8_lossy(&word);
            let answer = match word.split_once("send 601 8 ") {
                Some((_, bytes)) => {
                    requests.push(bytes.replace(' ', ""));
                    frames(answers.next().unwrap_or(&""))
                }
                None => "< ok >".to_owned(),
            };
            stream.write_all(answer.as_bytes()).unwrap();
        }
        requests
    });
    let address = BusAddress::from(address::parse(&at).unwrap());
    (Bus::join(&address).unwrap(), server)
}

/// "581:4300 601:40" as words of the server; without an identifier it is 581.
fn frames(text: &str) -> String {
    let frames = text.split_whitespace();
    let words = frames.map(|frame| {
        let (id, bytes) = frame.split_once(':').unwrap_or(("581", frame));
        format!("< frame {id} 1.0 {bytes:0<16} >")
    });
    words.collect()
}

fn at(index: u16, sub: u8) -> At {
    At { index, sub }
}

#[test]
fn a_lost_poll_ended_an_update() {
    let (mut bus, server) = bus(&["", "", "", "43571F0101000000"]);
    assert_eq!(Client::new(&mut bus, 1).read_u32(0x1F57, 1).unwrap(), 1);
    drop(bus);
    assert_eq!(questions(&server.join().unwrap()), 3);
}

/// Requests that are no aborts.
fn questions(requests: &[String]) -> usize {
    let is_abort = |request: &&String| request.starts_with("80");
    requests.len() - requests.iter().filter(is_abort).count()
}

/// The adapter was unplugged in a block download: each later request was taken for a segment of it.
#[test]
fn a_block_download_that_was_left_made_the_node_silent() {
    let (mut bus, server) = bus(&["", "", "", "4318100202000000"]);
    assert_eq!(Client::new(&mut bus, 1).read_u32(0x1018, 2).unwrap(), 2);
    drop(bus);
    let asked = server.join().unwrap();
    assert_eq!(asked[2], "8018100200000405");
    assert_eq!(asked[3], "4018100200000000");
}

#[test]
fn a_transfer_of_somebody_else_is_not_aborted() {
    let (mut bus, server) = bus(&["601:4000100000000000"; 3]);
    let asked = Client::new(&mut bus, 1).upload(0x1018, 0);
    assert!(matches!(asked, Err(SdoError::Taken(1))), "{asked:?}");
    drop(bus);
    assert_eq!(server.join().unwrap().len(), 3);
}

#[test]
fn a_late_answer_was_taken_for_another_one() {
    let (mut bus, server) = bus(&[
        "",
        // Both answers come, the second one later, behind one to nobody's request.
        "43571F0101000000 4380200207000000 43571F0101000000",
        "43571F0102000000",
        "601F510100000000 60511F0100000000",
    ]);
    let mut client = Client::new(&mut bus, 1);
    assert_eq!(client.read_u32(0x1F57, 1).unwrap(), 1);
    assert_eq!(client.read_u32(0x1F57, 1).unwrap(), 2);
    client.download(0x1F51, 1, &[3]).unwrap();
    drop(bus);
    assert_eq!(server.join().unwrap().len(), 4);
}

#[test]
fn a_write_is_not_sent_twice() {
    let (mut bus, server) = bus(&[]);
    let silent = Client::new(&mut bus, 1).download(0x6012, 0, &[0, 0]);
    assert!(matches!(silent, Err(SdoError::Unanswered(1, 0x6012, 0))));
    drop(bus);
    assert_eq!(server.join().unwrap(), ["2B12600000000000"]);
}

#[test]
fn a_download_whose_first_request_was_lost_was_never_begun() {
    let (mut bus, server) = bus(&["", "", "60612000", "20", "30"]);
    let mut client = Client::new(&mut bus, 1);
    client.download(0x2061, 0, &[0x5A; 10]).unwrap();
    drop(bus);
    let asked = server.join().unwrap();
    let [begun, given_up, again, ..] = &asked[..] else {
        panic!("{asked:?}");
    };
    assert_eq!((&begun[..8], &given_up[..8]), ("21612000", "80612000"));
    assert_eq!((begun, asked.len()), (again, 5));
}

#[test]
fn a_block_download_whose_first_request_was_lost_was_never_begun() {
    let (mut bus, server) = bus(&[
        "",
        "",
        "A46120007F",
        "",
        "",
        "",
        "",
        "",
        "",
        "",
        "",
        "",
        "A20A7F",
        "A1",
    ]);
    let mut client = Client::new(&mut bus, 1);
    client.download(0x2061, 0, &[0x5A; 70]).unwrap();
    drop(bus);
    assert_eq!(server.join().unwrap().len(), 14);
}

#[test]
fn a_question_that_nobody_answers_is_asked_three_times() {
    let (mut bus, server) = bus(&[]);
    let silent = Client::new(&mut bus, 1).upload(0x1000, 0);
    assert!(matches!(silent, Err(SdoError::Silent(1, 0x1000, 0))));
    drop(bus);
    assert_eq!(questions(&server.join().unwrap()), 3);
}

#[test]
fn expedited_contents_have_one_to_four_bytes() {
    let (mut bus, _server) = bus(&[
        "4F0110007F",
        "4B01100001FF",
        "4701100001020300",
        "4301100001020304",
    ]);
    let mut client = Client::new(&mut bus, 1);
    for length in 1..=4 {
        assert_eq!(client.upload(0x1001, 0).unwrap().len(), length);
    }
}

#[test]
fn segments_go_up_with_their_toggle_and_their_length() {
    let (mut bus, server) = bus(&["410810000A", "00506C756D622069", "196E636C", ""]);
    let text = Client::new(&mut bus, 1).upload(0x1008, 0).unwrap();
    // Ten bytes announced: seven, then three of the last segment (n = 4, last).
    assert_eq!(text.len(), 10, "{text:?}");
    drop(bus);
    let asked = server.join().unwrap();
    assert_eq!(&asked[1][..2], "60");
    assert_eq!(&asked[2][..2], "70");
}

#[test]
fn a_toggle_bit_that_stands_still_is_out_of_step() {
    let (mut bus, server) = bus(&[
        "410810000A",
        "10506C756D62",
        "",
        "",
        "410810000A",
        "10",
        "",
        "",
        "410810000A",
        "10",
    ]);
    let stepped = Client::new(&mut bus, 1).upload(0x1008, 0).unwrap_err();
    assert!(
        stepped
            .to_string()
            .contains("the toggle bit did not alternate"),
        "{stepped}"
    );
    drop(bus);
    // The node is told why.
    assert!(
        server
            .join()
            .unwrap()
            .contains(&"8008100000000305".to_owned())
    );
}

#[test]
fn segments_go_down_each_answered() {
    let (mut bus, server) = bus(&["60A92F", "20", "30"]);
    Client::new(&mut bus, 1)
        .download(0x2FA9, 0, b"12345678")
        .unwrap();
    drop(bus);
    let asked = server.join().unwrap();
    assert_eq!(
        asked,
        ["21A92F0008000000", "0031323334353637", "1D38000000000000"]
    );
}

#[test]
fn blocks_come_up_also_when_a_segment_is_lost() {
    let (mut bus, server) = bus(&[
        // 70 bytes announced; the abort of the first request; then in blocks.
        "4170200046",
        "",
        "C670200046",
        // Segment 3 is missing.
        "0141414141414141 0241414141414141 0441414141414141 0541414141414141 0641414141414141 \
         0741414141414141 0841414141414141 0941414141414141 8A41414141414141",
        "0141414141414141 0241414141414141 0341414141414141 0441414141414141 0541414141414141 \
         0641414141414141 0741414141414141 8841414141414141",
    ]);
    let upload = Client::new(&mut bus, 1).upload(0x2070, 0);
    // The end of the transfer never comes; all segments did.
    assert!(upload.is_err());
    drop(bus);
    let asked = server.join().unwrap();
    assert_eq!(asked[2], "A47020007F000000");
    assert_eq!(&asked[4][..6], "A2027F");
    assert_eq!(&asked[5][..6], "A2087F");
}

#[test]
fn a_block_upload_with_a_wrong_check_sum_is_refused_and_asked_for_again() {
    const SEGMENTS: &str = "0141414141414141 0241414141414141 0341414141414141 0441414141414141 \
                            0541414141414141 0641414141414141 0741414141414141 0841414141414141 \
                            0941414141414141 8A41414141414141";
    let (mut bus, server) = bus(&[
        "4170200046",
        "",
        "C670200046",
        SEGMENTS,
        "C1FFFF",
        "",
        "",
        "4170200046",
        "",
        "C670200046",
        SEGMENTS,
        "C1E153",
    ]);
    let content = Client::new(&mut bus, 1).upload(0x2070, 0);
    drop(bus);
    let asked = server.join().unwrap();
    assert_eq!(&asked[5][8..], "04000405", "0504 0004h tells the node why");
    assert_eq!(content.unwrap(), [0x41; 70]);
}

#[test]
fn aborts_are_refusals_with_their_code() {
    let (mut bus, _server) = bus(&["8018100911000906"]);
    match Client::new(&mut bus, 1).upload(0x1018, 9) {
        Err(SdoError::Refused(1, 0x1018, 9, 0x0609_0011)) => {}
        other => panic!("{other:?}"),
    }
}

#[test]
fn somebody_else_on_the_channel_is_named() {
    // Silence, while requests of another client pass.
    let (mut bus, _server) = bus(&["601:4000100000000000", "601:4000100000000000"]);
    let asked = Client::new(&mut bus, 1).upload(0x1018, 1);
    assert!(matches!(asked, Err(SdoError::Taken(1))), "{asked:?}");
}

#[test]
fn an_answer_to_another_clients_write_of_the_same_object_was_taken_for_ours() {
    let (mut bus, _server) = bus(&["601:2B12600001000000 6012600000000000"]);
    let written = Client::new(&mut bus, 1).download(0x6012, 0, &[0, 0]);
    assert!(matches!(written, Err(SdoError::Taken(1))), "{written:?}");
}

#[test]
fn an_answer_to_somebody_elses_question_is_passed_over() {
    let (mut bus, _server) = bus(&["601:4000100000000000 43001000FF000000 43181001EE000000"]);
    let number = Client::new(&mut bus, 1).read_u32(0x1018, 1);
    assert_eq!(number.unwrap(), 0xEE);
}

#[test]
fn a_text_is_no_number() {
    let (mut bus, _server) = bus(&["4108100006", "03506C756D6221"]);
    let told = Client::new(&mut bus, 1).read_u32(0x1008, 0).unwrap_err();
    assert_eq!(
        told.to_string(),
        "1008h of node 1 has 6 bytes and is no number"
    );
}

#[test]
fn requests_name_object_and_length() {
    assert_eq!(
        at(0x6012, 3).request(0x40, 0),
        [0x40, 0x12, 0x60, 3, 0, 0, 0, 0]
    );
    assert_eq!(expedited(at(0x1F51, 1), &[3])[0], 0x2F);
    assert_eq!(expedited(at(0x1F51, 1), &[3, 0, 0, 0])[0], 0x23);
}

/// A server that never stops sending. A wait for an answer has to end in time all the same.
#[test]
fn a_bus_that_was_never_still_kept_a_client_waiting_for_ever() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = listener.local_addr().unwrap().to_string();
    spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        stream.write_all(b"< hi >< ok >< ok >").unwrap();
        let flood = "< frame 181 1.0 0102030405060708 >".repeat(100);
        while stream.write_all(flood.as_bytes()).is_ok() {}
    });
    let address = BusAddress::from(address::parse(&at).unwrap());
    let mut bus = Bus::join(&address).unwrap();
    let from = Instant::now();
    let silent = Client::new(&mut bus, 1).upload(0x1000, 0);
    assert!(matches!(silent, Err(SdoError::Silent(..))), "{silent:?}");
    // It waits two seconds; a wait that ends in time is far from one without an end.
    assert!(from.elapsed() < Duration::from_secs(60));
}

/// Segments that begin nowhere and end nowhere.
#[test]
fn any_answers_end_an_upload_somehow() {
    let (mut bus, _server) = bus(&[
        "41082000FFFFFFFF",
        "",
        "C60820FF00000000",
        "FF00 7F00 0000 8100",
        "FF00 7F00 0000 8100",
        "8000000000000000",
    ]);
    let ended = Client::new(&mut bus, 1).upload(0x2008, 0);
    assert!(ended.is_err(), "{ended:?}");
}
