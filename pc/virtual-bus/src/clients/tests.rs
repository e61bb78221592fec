//! Clients of a bus, as conversations over real connections.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use canopen::Frame;
use canopen::frame::standard;

use super::hub::Hub;
use super::round_robin::ClientId;
use super::shared::CLIENTS_LIMIT;
use crate::error::ServeError;

/// Long enough for a machine that is busy with others; what is waited for ends the wait.
const SOON: Duration = Duration::from_secs(30);

/// Every client's frames are wanted.
fn any(_: ClientId) -> bool {
    true
}

fn here() -> SocketAddr {
    ([127, 0, 0, 1], 0).into()
}

/// One client's connection.
struct Peer(TcpStream);

impl Peer {
    fn new(at: SocketAddr) -> Self {
        let stream = TcpStream::connect(at).unwrap();
        stream.set_read_timeout(Some(SOON)).unwrap();
        stream.set_nodelay(true).unwrap();
        Self(stream)
    }

    /// A socketcand client in raw mode.
    fn raw(at: SocketAddr) -> Self {
        let mut peer = Self::new(at);
        peer.hears("< hi >");
        peer.sends("< open plumb >");
        peer.hears("< ok >");
        peer.sends("< rawmode >");
        peer.hears("< ok >");
        peer
    }

    fn sends(&mut self, text: &str) {
        self.0.write_all(text.as_bytes()).unwrap();
    }

    fn hears(&mut self, text: &str) {
        let mut bytes = vec![0; text.len()];
        self.0.read_exact(&mut bytes).unwrap();
        assert_eq!(String::from_utf8(bytes).unwrap(), text);
    }

    /// All that comes until the other side closes.
    fn hears_the_end(&mut self) -> String {
        let mut text = String::new();
        self.0.read_to_string(&mut text).unwrap();
        text
    }

    fn hears_nothing_for(&mut self, time: Duration) {
        self.0.set_read_timeout(Some(time)).unwrap();
        assert!(self.0.read(&mut [0]).is_err());
        self.0.set_read_timeout(Some(SOON)).unwrap();
    }
}

fn socketcand() -> (Hub, SocketAddr) {
    let mut hub = Hub::new();
    let at = hub.listen_socketcand(here(), "plumb").unwrap();
    (hub, at)
}

/// Waits for a notice that holds these words.
fn notice(hub: &mut Hub, words: &str) -> String {
    let until = Instant::now() + SOON;
    let mut seen = Vec::new();
    while Instant::now() < until {
        seen.extend(hub.notices());
        if let Some(found) = seen.iter().find(|notice| notice.contains(words)) {
            return found.clone();
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("no notice with {words:?} in {seen:?}");
}

/// What one receive call brings, as python-can has it, of an answer to `rawmode` and a frame that
/// is sent right behind it; and how long both took. The frame has come by then.
fn answer_and_frame() -> (String, Duration, Duration) {
    let (mut hub, at) = socketcand();
    let mut peer = Peer::new(at);
    peer.hears("< hi >");
    peer.sends("< open plumb >");
    peer.hears("< ok >");
    let asked = Instant::now();
    peer.sends("< rawmode >");
    while hub.clients() == 0 {
        hub.wait(Duration::from_micros(100), any);
    }
    hub.send(&Frame::data_frame(0x701, &[5]), 1_500_000, None);
    let mut bytes = [0; 256];
    let length = peer.0.read(&mut bytes).unwrap();
    let answered = asked.elapsed();
    let text = String::from_utf8(bytes[..length].to_vec()).unwrap();
    if text == "< ok >" {
        peer.hears("< frame 701 1.500000 05 >");
    }
    (text, answered, asked.elapsed())
}

/// The answer must come alone. A machine that was busy with others for all of the 20 ms shows
/// nothing of that, so it is asked again.
#[test]
fn a_frame_sent_right_after_rawmode_is_held_back_20_ms() {
    let held = Duration::from_millis(20);
    for _ in 0..100 {
        let (answer, answered, all) = answer_and_frame();
        assert!(all >= held, "{all:?}");
        if answered < held {
            assert_eq!(answer, "< ok >");
            return;
        }
    }
    panic!("no answer within {held:?}");
}

#[test]
fn frames_reach_the_bus_and_all_clients_but_the_sender() {
    let (mut hub, at) = socketcand();
    let mut one = Peer::raw(at);
    let mut other = Peer::raw(at);
    assert_eq!(hub.clients(), 2);
    one.sends("< send 080 0  >");
    assert!(hub.wait(SOON, any));
    let incoming = hub.receive(any).unwrap();
    assert_eq!(incoming.frame, Frame::data_frame(0x80, &[]));
    hub.send(&incoming.frame, 2_000_001, Some(incoming.client));
    other.hears("< frame 080 2.000001  >");
    one.hears_nothing_for(Duration::from_millis(50));
    assert_eq!(hub.receive(any), None);
}

#[test]
fn garbage_is_answered_and_the_connection_closed() {
    let (mut hub, at) = socketcand();
    let mut peer = Peer::raw(at);
    peer.sends(&"< what >".repeat(20));
    let said = peer.hears_the_end();
    assert_eq!(said.matches("< error what is not offered").count(), 8);
    assert!(notice(&mut hub, "dropped").contains("8 faults in a row"));
    assert_eq!(hub.clients(), 0);
}

#[test]
fn an_endless_command_is_answered_and_the_connection_closed() {
    let (mut hub, at) = socketcand();
    let mut peer = Peer::raw(at);
    peer.sends(&format!("< {}", "a".repeat(100_000)));
    assert_eq!(
        peer.hears_the_end(),
        "< error a command is longer than 96 bytes >"
    );
    notice(&mut hub, "longer than 96 bytes");
}

#[test]
fn a_client_that_leaves_is_noticed_and_gone() {
    let (mut hub, at) = socketcand();
    let peer = Peer::raw(at);
    assert!(notice(&mut hub, "connected").starts_with("socketcand client 127.0.0.1:"));
    drop(peer);
    assert!(notice(&mut hub, "left").starts_with("socketcand client 127.0.0.1:"));
    assert_eq!(hub.clients(), 0);
    hub.send(&Frame::data_frame(0x80, &[]), 0, None);
}

#[test]
fn a_client_that_does_not_read_is_dropped_and_nobody_waits() {
    let (mut hub, at) = socketcand();
    let _sleeper = Peer::raw(at);
    let frame = Frame::data_frame(0x181, &[0; 8]);
    let mut sent = 0;
    while hub.clients() == 1 && sent < 2_000_000 {
        hub.send(&frame, 0, None);
        sent += 1;
    }
    assert_eq!(hub.clients(), 0, "{sent} frames");
    // Who waits for the client, waits for ever, or until a write takes too long: the reason to
    // drop it would be that one.
    assert!(notice(&mut hub, "dropped").contains("doesn't read its frames, 1024 kB wait"));
}

#[test]
fn a_client_that_sends_too_fast_is_slowed_down() {
    let (mut hub, at) = socketcand();
    let mut peer = Peer::raw(at);
    let sender = std::thread::spawn(move || {
        for _ in 0..200 {
            peer.sends(&"< send 181 8 1 2 3 4 5 6 7 8 >".repeat(500));
        }
        peer
    });
    let mut received = 0;
    while hub.wait(SOON, any) {
        assert!(hub.receive(any).is_some());
        received += 1;
        if received == 100_000 {
            break;
        }
    }
    assert_eq!(received, 100_000);
    drop(sender.join().unwrap());
}

#[test]
fn a_burst_arrives_complete_and_in_order() {
    let (mut hub, at) = socketcand();
    let mut peer = Peer::raw(at);
    let reader = std::thread::spawn(move || {
        for number in 0_u16..20_000 {
            let [high, low] = number.to_be_bytes();
            peer.hears(&format!("< frame 181 0.000000 {high:02X}{low:02X} >"));
        }
    });
    for number in 0_u16..20_000 {
        while hub.is_congested() {
            std::thread::yield_now();
        }
        hub.send(&Frame::data_frame(0x181, &number.to_be_bytes()), 0, None);
    }
    reader.join().unwrap();
}

#[test]
fn one_more_client_than_there_is_room_for_is_refused() {
    let (mut hub, at) = socketcand();
    let peers: Vec<Peer> = (0..CLIENTS_LIMIT).map(|_| Peer::raw(at)).collect();
    assert_eq!(Peer::new(at).hears_the_end(), "");
    notice(&mut hub, "refused: 32 clients are here already");
    assert_eq!(hub.clients(), peers.len());
}

#[test]
fn clients_that_never_opened_the_bus_shut_everybody_out_for_good() {
    // Long beside what a busy machine takes to open the bus, and to leave off talking in time.
    let limit = Duration::from_secs(4);
    let mut hub = Hub::with_time_limit(limit);
    let at = hub.listen_socketcand(here(), "plumb").unwrap();
    let slcan_at = hub.listen_slcan(here()).unwrap();
    // Some send nothing, some the wrong things all the time.
    let mut silent: Vec<Peer> = (0..CLIENTS_LIMIT / 2).map(|_| Peer::new(at)).collect();
    let mut talking: Vec<Peer> = (silent.len()..CLIENTS_LIMIT)
        .map(|_| Peer::new(slcan_at))
        .collect();
    notice(&mut hub, "SLCAN");
    let until = Instant::now() + Duration::from_millis(500);
    while Instant::now() < until {
        talking.iter_mut().for_each(|peer| peer.sends("V\r"));
        std::thread::sleep(Duration::from_millis(20));
    }
    let said = silent.remove(0).hears_the_end();
    assert_eq!(said, "< hi >< error the bus was not opened within 4s >");
    let last = talking.pop().unwrap().hears_the_end();
    assert!(last.ends_with("V0100\r"), "{last}");
    notice(&mut hub, "dropped: the bus was not opened within 4s");
    for mut peer in silent.into_iter().chain(talking) {
        peer.hears_the_end();
    }
    let guests: Vec<Peer> = (0..CLIENTS_LIMIT).map(|_| Peer::raw(at)).collect();
    assert_eq!(hub.clients(), guests.len());
    // Who has it open may be silent for ever.
    std::thread::sleep(limit + Duration::from_millis(100));
    assert_eq!(hub.clients(), guests.len());
}

#[test]
fn an_adapter_that_is_closed_again_may_stay_as_long_as_a_new_one() {
    // Long beside what a busy machine takes to open the bus.
    let limit = Duration::from_secs(3);
    let mut hub = Hub::with_time_limit(limit);
    let at = hub.listen_slcan(here()).unwrap();
    let mut peer = Peer::new(at);
    peer.sends("O\r");
    peer.hears("\r");
    std::thread::sleep(limit + Duration::from_millis(100));
    peer.sends("C\rV\r");
    peer.hears("\rV0100\r");
    let closed = Instant::now();
    assert_eq!(peer.hears_the_end(), "");
    assert!(closed.elapsed() > limit / 2);
}

#[test]
fn beside_a_client_that_floods_another_waited_for_all_of_its_frames() {
    let (mut hub, at) = socketcand();
    let mut flooder = Peer::raw(at);
    let mut guest = Peer::raw(at);
    let flood = std::thread::spawn(move || {
        for _ in 0..20 {
            flooder.sends(&"< send 7ff 8 1 2 3 4 5 6 7 8 >".repeat(500));
        }
        flooder
    });
    assert!(hub.wait(SOON, any));
    let flooding = hub.receive(any).unwrap().client;
    // The flood has filled its own queue and stands.
    std::thread::sleep(Duration::from_millis(200));
    guest.sends("< send 601 0  >");
    assert!(hub.wait(SOON, |client| client != flooding));
    let next = [(); 2].map(|()| hub.receive(any).unwrap().frame.cob_id());
    assert!(next.contains(&Some(0x601)), "{next:X?}");
    let mut rest = 0;
    while rest < 9_998 && hub.wait(SOON, any) {
        rest += usize::from(hub.receive(any).is_some());
    }
    assert_eq!(rest, 9_998);
    drop(flood.join().unwrap());
}

#[test]
fn a_port_in_use_is_named_with_the_way_out() {
    let (_hub, at) = socketcand();
    let error = Hub::new().listen_slcan(at).unwrap_err();
    assert!(matches!(error, ServeError::PortInUse(_, "--slcan")));
    let sentence = error.to_string();
    assert!(sentence.starts_with(&format!("port {} of 127.0.0.1 is in use", at.port())));
    assert!(sentence.contains("--slcan 127.0.0.1:"), "{sentence}");
}

#[test]
fn a_port_is_free_again_when_the_hub_is_gone() {
    let (hub, at) = socketcand();
    let mut peer = Peer::raw(at);
    drop(hub);
    assert_eq!(peer.hears_the_end(), "");
    let until = Instant::now() + SOON;
    while Hub::new().listen_slcan(at).is_err() {
        assert!(Instant::now() < until);
    }
}

#[test]
fn an_address_of_another_machine_is_refused() {
    let elsewhere = ([192, 0, 2, 1], 29536).into();
    let sentence = Hub::new().listen_slcan(elsewhere).unwrap_err().to_string();
    assert!(
        sentence.starts_with("cannot listen on 192.0.2.1:29536: "),
        "{sentence}"
    );
}

#[test]
fn a_name_with_a_space_is_no_bus() {
    for name in ["", "two words", "<", "sixteen-letters-"] {
        let refused = Hub::new().listen_socketcand(here(), name);
        assert!(matches!(refused, Err(ServeError::BusName(_))), "{name}");
    }
}

#[test]
fn an_address_open_to_the_network_is_noticed() {
    let mut hub = Hub::new();
    hub.listen_slcan(([0, 0, 0, 0], 0).into()).unwrap();
    notice(&mut hub, "is open to the network");
}

#[test]
fn slcan_over_tcp_asks_for_a_node_guard() {
    let mut hub = Hub::new();
    let at = hub.listen_slcan(here()).unwrap();
    let mut peer = Peer::new(at);
    peer.sends("C\rS8\rO\r");
    peer.hears("\x07\r\r");
    peer.sends("r7011\r");
    peer.hears("z\r");
    assert!(hub.wait(SOON, any));
    let incoming = hub.receive(any).unwrap();
    assert_eq!(incoming.frame, Frame::remote(standard(0x701), 1).unwrap());
    hub.send(&incoming.frame, 0, Some(incoming.client));
    hub.send(&Frame::data_frame(0x701, &[5]), 0, None);
    peer.hears("t701105\r");
    hub.send(&incoming.frame, 0, None);
    peer.hears("r7011\r");
    peer.sends("C\r");
    peer.hears("\r");
    assert_eq!(hub.clients(), 0);
}

#[test]
fn socketcand_and_slcan_share_a_bus() {
    let (mut hub, at) = socketcand();
    let slcan_at = hub.listen_slcan(here()).unwrap();
    let mut text = Peer::raw(at);
    let mut line = Peer::new(slcan_at);
    line.sends("O\r");
    line.hears("\r");
    line.sends("T00000181 0\rT000001811FF\r");
    line.hears("\x07Z\r");
    assert!(hub.wait(SOON, any));
    let incoming = hub.receive(any).unwrap();
    hub.send(&incoming.frame, 7, Some(incoming.client));
    text.hears("< frame 00000181 0.000007 FF >");
}

#[test]
fn answers_that_nobody_reads_end_the_connection() {
    let mut hub = Hub::new();
    let at = hub.listen_slcan(here()).unwrap();
    let mut peer = Peer::new(at);
    let flood = "V\r".repeat(10_000);
    let until = Instant::now() + SOON;
    while peer.0.write_all(flood.as_bytes()).is_ok() && Instant::now() < until {}
    notice(&mut hub, "dropped");
}

#[cfg(target_os = "linux")]
#[test]
fn a_missing_interface_is_named() {
    let sentence = Hub::new().open_kernel("nocan7").unwrap_err().to_string();
    assert!(sentence.contains("CAN interface nocan7"), "{sentence}");
}

#[cfg(unix)]
mod terminal {
    use super::*;
    use std::fs::{File, OpenOptions};
    use std::path::Path;

    fn opened(path: &Path) -> File {
        OpenOptions::new()
            .read(true)
            .write(true)
            .open(path)
            .unwrap()
    }

    fn hears(file: &mut File, text: &str) {
        let mut bytes = vec![0; text.len()];
        file.read_exact(&mut bytes).unwrap();
        assert_eq!(String::from_utf8(bytes).unwrap(), text);
    }

    #[test]
    fn a_terminal_serves_one_client_after_the_other() {
        let mut hub = Hub::new();
        let path = hub.open_pty().unwrap();
        for round in 0_u8..3 {
            let mut file = opened(&path);
            file.write_all(b"S8\rO\rt0800\r").unwrap();
            hears(&mut file, "\r\rz\r");
            assert!(hub.wait(SOON, any));
            assert_eq!(
                hub.receive(any).unwrap().frame,
                Frame::data_frame(0x80, &[])
            );
            hub.send(&Frame::data_frame(0x181, &[round]), 0, None);
            hears(&mut file, &format!("t1811{round:02X}\r"));
            // What stays unread must not meet the next client.
            hub.send(&Frame::data_frame(0x182, &[round]), 0, None);
            drop(file);
            assert!(notice(&mut hub, "left without").contains(&*path.to_string_lossy()));
        }
    }

    #[test]
    fn a_terminal_nobody_reads_is_closed_and_opens_again() {
        let mut hub = Hub::new();
        let path = hub.open_pty().unwrap();
        let mut file = opened(&path);
        file.write_all(b"O\r").unwrap();
        hears(&mut file, "\r");
        let frame = Frame::data_frame(0x181, &[0; 8]);
        let mut sent = 0;
        while hub.clients() == 1 && sent < 1_000_000 {
            hub.send(&frame, 0, None);
            sent += 1;
        }
        assert_eq!(hub.clients(), 0);
        notice(&mut hub, "doesn't read its frames; it may open again");
        drop(file);
        std::thread::sleep(Duration::from_millis(200));
        let mut file = opened(&path);
        file.write_all(b"V\r").unwrap();
        hears(&mut file, "V0100\r");
    }
}
