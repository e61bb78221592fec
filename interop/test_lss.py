"""LSS: node-ids and bit rates without an SDO (CiA 305)."""

from __future__ import annotations

import pathlib
import struct
import zlib
from typing import Iterator

import canopen
import pytest
from master import EMULATED, PROBE, RESET_COMMUNICATION, START, Master, Plumb, until

ANSWER, REQUEST = 0x7E4, 0x7E5
WAITING, CONFIGURING = 0, 1
VENDOR, PRODUCTS, REVISION = 0, (0x504C_0001, 0x504C_0002), 0x0001_0000


# An answer of LSS comes within milliseconds; silence is waited for as long.
PATIENT_S = 5.0


@pytest.fixture
def bare() -> Iterator[Plumb]:
    """A bus of two nodes without node-ids."""
    with Plumb("--node-ids", "none", "--uncalibrated") as plumb:
        yield plumb


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb("--uncalibrated") as plumb:
        yield plumb


@pytest.fixture
def master(plumb: Plumb) -> Iterator[Master]:
    """A master of nodes 1 and 2, fresh from a reset and waiting."""
    with Master(plumb) as master:
        lss(master).send_switch_state_global(WAITING)
        mark = master.mark()
        master.nmt(RESET_COMMUNICATION)
        for node in (1, 2):
            master.next(0x700 + node, mark, data=lambda data: data == b"\0")
        yield master


def lss(master: Master) -> canopen.lss.LssMaster:
    """The LSS master of python-canopen, with patience for a busy machine."""
    client = master.network.lss
    client.RESPONSE_TIMEOUT = PATIENT_S
    return client


def serial(node: int) -> int:
    """The image makes it of the chip's identity: for an emulated one, seed and place."""
    return zlib.crc32(struct.pack("<QI", 1, node - 1)) if EMULATED else node


def identity(node: int) -> tuple[int, int, int, int]:
    return VENDOR, PRODUCTS[node - 1], REVISION, serial(node)


def select(master: Master, node: int) -> canopen.lss.LssMaster:
    """Brings one of the delivered nodes into the configuration state by its identity."""
    client = lss(master)
    assert client.send_switch_state_selective(*identity(node))
    return client


def request(master: Master, *data: int, answers: int = 1) -> list[bytes]:
    """Sends a frame of LSS; its answers, when so many have come and a little time has passed."""
    mark = master.mark()
    master.send(REQUEST, bytes(data).ljust(8, b"\0"))
    until(lambda: len(master.since(mark, ANSWER)) >= answers, f"{answers} answers of LSS")
    master.rest(0.1)
    return [bytes(frame.data) for frame in master.since(mark, ANSWER)]


def test_two_nodes_without_node_ids_are_silent_and_report_it_when_asked(bare: Plumb) -> None:
    with Master(bare, nodes=()) as master:
        master.send(0x601, bytes.fromhex("4018100100000000"))
        # Both answer with the same frame, which is one where they come at the same time.
        answers = request(master, 0x4C)
        assert answers and all(answer == b"\x50" + bytes(7) for answer in answers)
        spoken = {frame.arbitration_id for frame in master.frames}
        assert spoken <= {ANSWER, PROBE}


def scan(client: canopen.lss.LssMaster) -> tuple[int, ...]:
    """The identity of the next unconfigured node.

    Every other question is answered by silence, so each scan has less patience than LSS otherwise.
    An answer that a busy machine delays counts as silence, and then nobody is found: as a person
    would, it asks again, but not for ever.
    """
    client.RESPONSE_TIMEOUT = 0.3
    try:
        for _ in range(6):
            there, numbers = client.fast_scan()
            if there:
                return tuple(numbers)
    finally:
        client.RESPONSE_TIMEOUT = PATIENT_S
    raise AssertionError("no unconfigured node was found in six scans")


def test_fastscan_finds_both_unconfigured_nodes_one_after_the_other(bare: Plumb) -> None:
    with Master(bare, nodes=()) as master:
        client = lss(master)
        found = []
        for node_id in (10, 11):
            found.append(scan(client))
            client.configure_node_id(node_id)
            mark = master.mark()
            client.send_switch_state_global(WAITING)
            # A node that had no node-id boots with the new one when LSS lets it go.
            boot = master.next(0x700 + node_id, mark)
            assert bytes(boot.data) == b"\0"
        assert sorted(found) == sorted([identity(1), identity(2)])
        assert client.fast_scan() == (False, None)
        node = master.network.add_node(10, canopen.ObjectDictionary())
        assert node.sdo.upload(0x1018, 4) == found[0][3].to_bytes(4, "little")


@pytest.mark.virtual("an emulated flash is not kept in files")
def test_assigned_node_ids_that_were_stored_are_there_after_a_restart(
    tmp_path: pathlib.Path,
) -> None:
    """A sensor on the market answers to LSS store and forgets at power-off."""
    state = str(tmp_path)
    with Plumb("--node-ids", "none", "--uncalibrated", "--state", state) as plumb:
        with Master(plumb, nodes=()) as master:
            client = lss(master)
            for channel, node_id in ((0, 21), (1, 22)):
                assert client.send_switch_state_selective(*identity(channel + 1))
                client.configure_node_id(node_id)
                client.store_configuration()
                client.send_switch_state_global(WAITING)
    with Plumb("--node-ids", "none", "--uncalibrated", "--state", state) as plumb:
        assert "(21, 22)" in plumb.ready
        with Master(plumb, nodes=()) as master:
            for channel, node_id in ((0, 21), (1, 22)):
                node = master.network.add_node(node_id, canopen.ObjectDictionary())
                product = int.from_bytes(node.sdo.upload(0x1018, 2), "little")
                assert product == PRODUCTS[channel]


def test_a_node_id_that_was_not_stored_is_gone_after_a_reset_of_the_node(bare: Plumb) -> None:
    with Master(bare, nodes=()) as master:
        client = lss(master)
        assert client.send_switch_state_selective(*identity(1))
        client.configure_node_id(33)
        mark = master.mark()
        client.send_switch_state_global(WAITING)
        master.next(0x721, mark)
        bare.type("reset a")
        bare.rest(0.2)
        mark = master.mark()
        bare.rest(0.5)
        assert not master.since(mark, 0x721)
        # Both have none again: equal answers are one frame where they come at the same time.
        assert set(request(master, 0x4C)) == {b"\x50" + bytes(7)}


def test_a_new_node_id_of_a_configured_node_is_not_active_before_the_reset() -> None:
    with Plumb("--uncalibrated") as plumb, Master(plumb) as master:
        move(master)


def move(master: Master) -> None:
    """Node 1 becomes node 41, first without and then with a reset of communication."""
    client = select(master, 1)
    client.configure_node_id(41)
    assert client.inquire_node_id() == 1
    assert master.read(1, 0x1018, 4) == serial(1)
    client.send_switch_state_global(WAITING)
    mark = master.mark()
    with pytest.raises(AssertionError):
        master.next(0x729, mark, 0.5)
    master.next(0x701, mark)

    master.nmt(RESET_COMMUNICATION, 1)
    assert bytes(master.next(0x729, mark).data) == b"\0"
    moved = master.network.add_node(41, canopen.ObjectDictionary())
    assert moved.sdo.upload(0x1018, 4) == serial(1).to_bytes(4, "little")
    # The identifiers that follow the node-id have moved with it.
    assert moved.sdo.upload(0x1014, 0) == (0x80 + 41).to_bytes(4, "little")
    assert moved.sdo.upload(0x1800, 1) == (0x180 + 41).to_bytes(4, "little")


def test_global_and_selective_switch(master: Master) -> None:
    client = lss(master)
    client.send_switch_state_global(CONFIGURING)
    answers = request(master, 0x5E, answers=2)
    assert sorted(answer[:2] for answer in answers) == [b"\x5e\1", b"\x5e\2"]
    client.send_switch_state_global(WAITING)
    assert request(master, 0x5E, answers=0) == []

    select(master, 2)
    answers = request(master, 0x5E)
    assert [answer[:2] for answer in answers] == [b"\x5e\2"]
    client.send_switch_state_global(WAITING)
    with pytest.raises(canopen.lss.LssError):
        client.send_switch_state_selective(VENDOR, PRODUCTS[0], REVISION, 999)
    assert request(master, 0x5E, answers=0) == []


def test_inquiry_of_the_identity_and_of_the_node_id(master: Master) -> None:
    client = select(master, 2)
    parts = [client.inquire_lss_address(0x5A + part) for part in range(4)]
    assert tuple(parts) == identity(2)
    assert parts == [master.read(2, 0x1018, sub) for sub in range(1, 5)]
    assert client.inquire_node_id() == 2
    client.send_switch_state_global(WAITING)


LOWEST, HIGHEST = sorted([serial(1), serial(2)])


@pytest.mark.parametrize(
    "low, high, there",
    [(LOWEST, HIGHEST, 2), (HIGHEST, HIGHEST, 1), (HIGHEST + 1, HIGHEST + 7, 0)],
)
def test_identify_slaves_by_a_range_of_serial_numbers(
    master: Master, low: int, high: int, there: int
) -> None:
    answers = []
    for product in PRODUCTS:
        for specifier, number in (
            (0x46, VENDOR), (0x47, product), (0x48, REVISION), (0x49, REVISION), (0x4A, low),
        ):
            master.send(REQUEST, bytes([specifier, *number.to_bytes(4, "little"), 0, 0, 0]))
        answers += request(master, 0x4B, *high.to_bytes(4, "little"), answers=0)
    assert answers == [b"\x4f" + bytes(7)] * there


@pytest.mark.parametrize("node_id", [0, 128, 254])
def test_a_node_id_that_does_not_exist_is_refused(master: Master, node_id: int) -> None:
    client = select(master, 1)
    with pytest.raises(canopen.lss.LssError, match="LSS Error: 1"):
        client.configure_node_id(node_id)
    client.send_switch_state_global(WAITING)
    mark = master.mark()
    master.nmt(RESET_COMMUNICATION, 1)
    master.next(0x701, mark)


def test_bit_timings_of_the_standard_are_taken_and_others_refused(master: Master) -> None:
    client = select(master, 1)
    for index in (0, 1, 2, 3, 4, 6, 7, 8, 9):
        client.configure_bit_timing(index)
    # 5 is reserved, 10 and more don't exist, and table 1 is nobody's.
    for index in (5, 10, 255):
        with pytest.raises(canopen.lss.LssError, match="LSS Error: 1"):
            client.configure_bit_timing(index)
    assert request(master, 0x13, 1, 3) == [bytes([0x13, 1]) + bytes(6)]
    client.send_switch_state_global(WAITING)


def test_both_nodes_change_the_bit_rate_together() -> None:
    """Configured to 500 kbit/s, activated with a delay, and the master follows."""
    with Plumb("--uncalibrated") as plumb, Master(plumb) as master:
        client = lss(master)
        client.send_switch_state_global(CONFIGURING)
        # Equal answers of two nodes are one frame where they come at the same time.
        assert {answer[:2] for answer in request(master, 0x13, 0, 2)} == {b"\x13\0"}
        client.activate_bit_timing(100)
        plumb.type("+0.15 bit-rate 500")
        client.send_switch_state_global(WAITING)

        def follows(node: int) -> bool:
            # A heartbeat of before may still be on its way, and a question behind it is answered as
            # it is until the delay is over.
            return heard(master, node) and master.read(node, 0x2053, 1) == 500

        for node in (1, 2):
            until(lambda: follows(node), f"node {node} at 500 kbit/s", 6)


def heard(master: Master, node: int) -> bool:
    """Whether a heartbeat comes within a second."""
    mark = master.mark()
    try:
        return bool(master.next(0x700 + node, mark, 1.0))
    except AssertionError:
        return False


@pytest.mark.virtual("an emulated flash is not kept in files")
def test_a_stored_bit_rate_is_there_after_a_restart(tmp_path: pathlib.Path) -> None:
    state = str(tmp_path)
    with Plumb("--uncalibrated", "--state", state) as plumb, Master(plumb) as master:
        client = lss(master)
        for node in (1, 2):
            select(master, node)
            client.configure_bit_timing(2)
            client.store_configuration()
            client.send_switch_state_global(WAITING)
    options = ("--uncalibrated", "--state", state, "--bit-rate", "500")
    with Plumb(*options) as plumb, Master(plumb) as master:
        assert [master.read(node, 0x2053, 1) for node in (1, 2)] == [500, 500]


def test_lss_is_not_served_in_operational(master: Master) -> None:
    master.nmt(START, 1)
    master.next(0x701, master.mark(), data=lambda data: data == b"\5")
    with pytest.raises(canopen.lss.LssError):
        select(master, 1)


def test_a_short_frame_is_no_request(master: Master) -> None:
    client = select(master, 1)
    mark = master.mark()
    master.send(REQUEST, bytes([0x5E]))
    with pytest.raises(AssertionError):
        master.next(ANSWER, mark, 0.2)
    client.send_switch_state_global(WAITING)
