"""The ways onto the bus: socketcand, SLCAN over TCP and on a pseudo-terminal."""

from __future__ import annotations

import re
import socket
import subprocess
import time
from typing import Iterator

import can
import canopen
import pytest
from master import PLUMB, START, Master, Plumb, until

pytestmark = pytest.mark.virtual("the ways to the bus are the program's, not the node's")

IDENTITY = bytes.fromhex("4018100400000000")


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb("--uncalibrated", "--slcan", "127.0.0.1:0", "--pty") as plumb:
        yield plumb


@pytest.fixture
def master(plumb: Plumb) -> Iterator[Master]:
    with Master(plumb) as master:
        yield master


def places(plumb: Plumb) -> tuple[str, str]:
    """Where SLCAN clients connect: address and port, and the path of the terminal."""
    found = re.search(r"SLCAN (127\.0\.0\.1:\d+), SLCAN (/\S+)", plumb.ready)
    return found[1], found[2]


def tcp_adapter(plumb: Plumb) -> can.BusABC:
    return can.Bus(interface="slcan", channel=f"socket://{places(plumb)[0]}", sleep_after_open=0)


def pty_adapter(plumb: Plumb) -> can.BusABC:
    return can.Bus(interface="slcan", channel=places(plumb)[1], sleep_after_open=0)


def socketcand_client(plumb: Plumb) -> can.BusABC:
    return can.Bus(interface="socketcand", host="127.0.0.1", port=plumb.port, channel="plumb")


WAYS = {"socketcand": socketcand_client, "slcan-tcp": tcp_adapter, "slcan-pty": pty_adapter}


@pytest.fixture(params=WAYS)
def bus(request: pytest.FixtureRequest, plumb: Plumb) -> Iterator[can.BusABC]:
    """A client of each kind."""
    with WAYS[request.param](plumb) as bus:
        yield bus


def received(bus: can.BusABC, identifier: int, seconds: float = 30.0) -> can.Message | None:
    """The next frame with this identifier; `None` when none comes."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        frame = bus.recv(0.05)
        if frame and frame.arbitration_id == identifier:
            return frame
    return None


def plain(identifier: int, data: bytes = b"") -> can.Message:
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=False)


def test_sdo_works_by_every_way(bus: can.BusABC) -> None:
    bus.send(plain(0x602, IDENTITY))
    assert received(bus, 0x582).data == bytes.fromhex("4318100402000000")


def test_a_canopen_network_works_by_every_way(bus: can.BusABC) -> None:
    network = canopen.Network(bus)
    network.connect()
    node = network.add_node(1, canopen.ObjectDictionary())
    node.sdo.RESPONSE_TIMEOUT = 30.0
    assert node.sdo.upload(0x1008, 0) == b"Plumb inclinometer"
    assert node.nmt.wait_for_heartbeat(30) == "PRE-OPERATIONAL"
    network.notifier.stop(1)


def test_frames_sent_right_after_opening_are_not_lost(plumb: Plumb, bus: can.BusABC) -> None:
    """Those of the bus were read as part of the greeting and lost, and the answer with them."""
    bus.send(plain(0x601, IDENTITY))
    assert received(bus, 0x581)


@pytest.mark.parametrize("_", range(5))
def test_the_first_frames_after_rawmode_do_not_race_the_greeting(plumb: Plumb, _: int) -> None:
    """`babble` fills the bus, so that a frame waits for the client at any moment."""
    plumb.type("babble 7FF")
    plumb.truth()
    with socketcand_client(plumb) as bus:
        bus.send(plain(0x601, IDENTITY))
        answer = received(bus, 0x581)
    plumb.type("babble off")
    assert answer


def test_a_sync_without_bytes_arrives_by_every_way(master: Master, bus: can.BusABC) -> None:
    """In socketcand's text it has two spaces, and python-can drops it where one is missing."""
    master.write(1, 0x2050, 1, 0)
    master.nmt(START, 1)
    # Two clients' frames have no order but that of cause and effect.
    master.read(1, 0x1001)
    mark = master.mark()
    bus.send(plain(0x80))
    master.next(0x181, mark)
    assert bytes(master.next(0x80, mark).data) == b""
    master.sync()
    assert received(bus, 0x80).dlc == 0
    master.nmt(0x80, 1)


def test_a_client_sees_the_frames_of_the_others_and_not_its_own(
    master: Master, bus: can.BusABC
) -> None:
    mark = master.mark()
    bus.send(plain(0x7A1, b"from here"[:8]))
    assert bytes(master.next(0x7A1, mark).data) == b"from her"
    master.send(0x7A2, b"there")
    assert received(bus, 0x7A2).data == b"there"
    assert len(master.since(mark, 0x7A1)) == 1 and not master.since(mark, 0x7A2)


def test_extended_identifiers_pass_and_are_no_node_s(master: Master, bus: can.BusABC) -> None:
    mark = master.mark()
    # The lower bits are those of an SDO request to node 1.
    frame = can.Message(arbitration_id=0x1234_0601, data=IDENTITY, is_extended_id=True)
    bus.send(frame)
    until(lambda: [f for f in master.frames[mark:] if f.is_extended_id], "the frame")
    master.rest(0.1)
    assert not master.since(mark, 0x581)


def test_frames_of_a_burst_arrive_complete_and_in_order(
    master: Master, bus: can.BusABC
) -> None:
    mark = master.mark()
    for number in range(500):
        bus.send(plain(0x7A3, number.to_bytes(2, "big")))
    until(lambda: len(master.since(mark, 0x7A3)) == 500, "every frame", 10)
    came = [int.from_bytes(frame.data, "big") for frame in master.since(mark, 0x7A3)]
    assert came == list(range(500))


def test_a_remote_frame_passes_over_slcan_and_cannot_over_socketcand(plumb: Plumb) -> None:
    """Node guarding: the answer is the state with a toggle bit (CiA 301, node guarding)."""
    request = can.Message(
        arbitration_id=0x701, is_remote_frame=True, dlc=1, is_extended_id=False
    )
    with Master(plumb) as master, tcp_adapter(plumb) as adapter:
        master.write(1, 0x1017, 0, 0)
        states, first = [], master.mark()
        for _ in range(3):
            adapter.send(request)
            states.append(bytes(received(adapter, 0x701).data))
        assert [state[0] & 0x7F for state in states] == [127] * 3
        assert states[0] != states[1] and states[0] == states[2]
        # python-can writes a remote frame as one that has lost its bytes. It is refused, which
        # python-can takes for the end; nothing goes to the bus.
        until(lambda: len(master.since(first, 0x701)) == 3, "the same three for the master")
        mark = master.mark()
        with socketcand_client(plumb) as bus:
            bus.send(request)
            with pytest.raises(can.CanError):
                received(bus, 0x701)
        assert not master.since(mark, 0x701)
        master.reset(1, 0x82)


def test_slcan_adapters_answer_what_tools_ask_first(plumb: Plumb) -> None:
    with tcp_adapter(plumb) as adapter:
        assert adapter.get_version(30) == (1, 0)
        assert adapter.get_serial_number(30) == "PLMB"


def test_a_terminal_is_as_new_for_the_next_client(plumb: Plumb) -> None:
    for _ in range(3):
        with pty_adapter(plumb) as adapter:
            adapter.send(plain(0x601, IDENTITY))
            assert received(adapter, 0x581)


def test_another_bus_is_refused_by_name(plumb: Plumb) -> None:
    with socket.create_connection(("127.0.0.1", plumb.port), 30) as raw:
        assert raw.recv(64) == b"< hi >"
        raw.sendall(b"< open vcan7 >")
        answer = raw.recv(200).decode()
        assert answer.startswith("< error") and "plumb" in answer


def test_garbage_from_one_client_harms_no_other(plumb: Plumb, master: Master) -> None:
    with socket.create_connection(("127.0.0.1", plumb.port), 30) as raw:
        raw.sendall(bytes(range(256)) * 50)
    with socket.create_connection(places(plumb)[0].split(":"), 30) as raw:
        raw.sendall(bytes(range(256)) * 50)
    assert master.read(1, 0x1018, 4) == 1


def test_a_client_that_does_not_read_is_dropped_and_the_bus_goes_on(
    plumb: Plumb, master: Master
) -> None:
    lazy = socket.create_connection(("127.0.0.1", plumb.port), 30)
    lazy.sendall(b"< open plumb >< rawmode >")
    for _ in range(20):
        for _ in range(50):
            master.send(0x7A4, bytes(8))
        assert master.read(1, 0x1018, 4) == 1
    lazy.close()


def test_a_port_in_use_is_named_with_exit_status_2(plumb: Plumb) -> None:
    command = [PLUMB, "serve", "--uncalibrated", "--listen", f"127.0.0.1:{plumb.port}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and done.stdout == ""
    assert str(plumb.port) in done.stderr and len(done.stderr.splitlines()) == 1


def test_clients_learn_that_the_server_has_ended() -> None:
    """python-can's client spins for ever on a dead server; the connection itself tells."""
    with Plumb("--uncalibrated") as own:
        with socket.create_connection(("127.0.0.1", own.port), 30) as raw:
            own.type("quit")
            raw.settimeout(30)
            while raw.recv(4096):
                pass
        assert own.process.wait(30) == 0
