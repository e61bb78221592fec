"""NMT: boot-up, start, stop, pre-operational, resets (CiA 301, NMT services)."""

from __future__ import annotations

from typing import Iterator

import can
import pytest
from master import PRE_OPERATIONAL, RESET_COMMUNICATION, RESET_NODE, START, STOP
from master import Master, Plumb

INITIALISING, STOPPED, OPERATIONAL, PREOP = 0, 4, 5, 127
PERIOD = 20  # ms between two heartbeats


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb("--uncalibrated") as plumb:
        yield plumb


@pytest.fixture
def master(joined: Master) -> Master:
    """A master of both nodes, fresh from a reset; nothing here needs valid angles."""
    joined.reboot()
    return joined


@pytest.fixture
def beating(master: Master) -> Master:
    """Both nodes fresh from a reset, with a fast heartbeat and nothing that moves them."""
    for node in master.nodes:
        master.write(node, 0x1017, 0, PERIOD)
        master.write(node, 0x1016, 1, 0)
    return master


def state(master: Master, node: int) -> int:
    """The state in the third heartbeat from now: on a slow machine two may be on their way."""
    master.settle()
    mark = master.mark()
    for _ in range(3):
        beat = master.next(0x700 + node, mark)
        mark = master.frames.index(beat) + 1
    return beat.data[0]


def overruns(master: Master, node: int, mark: int) -> list[can.Message]:
    """The EMCY "CAN overrun" of a node since the mark."""
    return [f for f in master.since(mark, 0x80 + node) if f.data[:2] == b"\x10\x81"]


@pytest.mark.parametrize("command", [RESET_NODE, RESET_COMMUNICATION])
def test_the_boot_up_message_has_the_state_byte_zero(master: Master, command: int) -> None:
    mark = master.mark()
    master.nmt(command, 1)
    told = [master.next(0x701, mark, data=lambda data: data == b"\0")]
    told.append(master.next(0x701, master.frames.index(told[0]) + 1))
    assert [bytes(frame.data) for frame in told] == [b"\0", bytes([PREOP])]
    # One boot-up message, and only of the node that was reset.
    assert [f.data[0] for f in master.since(mark, 0x701)].count(INITIALISING) == 1
    assert INITIALISING not in [f.data[0] for f in master.since(mark, 0x702)]


@pytest.mark.sheets("objects of presets")
@pytest.mark.parametrize("command", [RESET_NODE, RESET_COMMUNICATION])
def test_a_reset_forgets_what_was_not_stored(beating: Master, command: int) -> None:
    beating.write(1, 0x6014, 0, 77)
    beating.reset(1, command)
    assert beating.read(1, 0x1017) == 200
    # Reset communication leaves the application alone (CiA 301, 7.3.2.1.4).
    assert beating.read(1, 0x6014) == (0 if command == RESET_NODE else 77)


@pytest.mark.parametrize(
    "commands, expected",
    [
        ([START], OPERATIONAL),
        ([STOP], STOPPED),
        ([START, STOP], STOPPED),
        ([STOP, START], OPERATIONAL),
        ([STOP, PRE_OPERATIONAL], PREOP),
        ([START, PRE_OPERATIONAL], PREOP),
        ([START, START], OPERATIONAL),
        ([START, STOP, PRE_OPERATIONAL, START], OPERATIONAL),
        ([PRE_OPERATIONAL, STOP], STOPPED),
    ],
)
def test_no_command_is_lost_when_another_follows(
    beating: Master, commands: list[int], expected: int
) -> None:
    reached = None
    for _ in range(3):
        mark = beating.mark()
        for command in commands:
            beating.nmt(command, 1)
        reached = state(beating, 1)
        # A node that erases a page keeps three of them, and reports that one was lost.
        if reached == expected or not overruns(beating, 1, mark):
            break
    assert reached == expected
    assert state(beating, 2) == PREOP


def test_commands_to_two_nodes_back_to_back_reach_both(beating: Master) -> None:
    beating.nmt(START, 1)
    beating.nmt(STOP, 2)
    assert (state(beating, 1), state(beating, 2)) == (OPERATIONAL, STOPPED)


@pytest.mark.parametrize("command, expected", [(START, OPERATIONAL), (STOP, STOPPED)])
def test_node_id_zero_means_all(beating: Master, command: int, expected: int) -> None:
    beating.nmt(command, 0)
    assert (state(beating, 1), state(beating, 2)) == (expected, expected)


@pytest.mark.parametrize(
    "data", [b"\x01\x09", b"\x4d\x01", b"\x01", b"", b"\x01\xc8", b"\x00\x01", b"\x81\x00\x00"]
)
def test_what_is_for_others_or_unknown_or_of_a_wrong_length_changes_nothing(
    beating: Master, data: bytes
) -> None:
    beating.send(0, data)
    assert state(beating, 1) == PREOP
    assert beating.read(1, 0x1017) == PERIOD


def test_python_canopen_commands_and_follows_a_node(beating: Master) -> None:
    nmt = beating.nodes[1].nmt
    nmt.state = "OPERATIONAL"
    assert state(beating, 1) == OPERATIONAL
    assert nmt.wait_for_heartbeat(30) == "OPERATIONAL"
    nmt.state = "RESET"
    nmt.wait_for_bootup(30)


@pytest.mark.sheets("angles come later")
def test_1f80_starts_a_node_by_itself(beating: Master) -> None:
    assert beating.read(1, 0x1F80) == 0
    beating.write(1, 0x1F80, 0, 8)
    assert state(beating, 1) == PREOP  # it is read at boot-up only
    assert beating.refusal(1, 0x1010, 1, b"save") == 0
    try:
        # Alone it has no angle to wait for: it has been compared with nobody.
        beating.reboot(1)
        assert (state(beating, 1), state(beating, 2)) == (OPERATIONAL, PREOP)
    finally:
        beating.nmt(PRE_OPERATIONAL, 1)
        assert beating.refusal(1, 0x1011, 1, b"load") == 0
    beating.reset(1)
    assert state(beating, 1) == PREOP
