"""Error control: heartbeat of a node and of others, and node guarding (CiA 301, error control)."""

from __future__ import annotations

import socket
import statistics
import time
from typing import Iterator

import can
import pytest
from master import PRE_OPERATIONAL, START, STOP, Master, Plumb, until

HEARTBEAT_LOST, OVER = 0x8130, 0x0000
STOPPED, OPERATIONAL, PREOP = 4, 5, 127
OTHER = 77  # a node that only the test plays


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


SLCAN = free_port()


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb("--slcan", f"127.0.0.1:{SLCAN}") as plumb:
        yield plumb


@pytest.fixture
def master(joined: Master) -> Master:
    """A master of both nodes, fresh from a reset; nothing here needs valid angles."""
    joined.reboot()
    return joined


@pytest.fixture
def alone(master: Master) -> Master:
    """The channels don't watch each other, so that what the test watches is all there is."""
    for node in master.nodes:
        master.write(node, 0x1016, 1, 0)
    return master


def emcy(master: Master, mark: int, code: int, timeout: float = 2.0) -> can.Message:
    """Node 1's EMCY with this code since the mark."""
    told = code.to_bytes(2, "little")
    return master.next(0x81, mark, timeout, data=lambda data: data[:2] == told)


def watch(master: Master, milliseconds: int, node: int = OTHER, sub: int = 2) -> None:
    """Lets node 1 supervise a heartbeat."""
    master.write(1, 0x1016, sub, node << 16 | milliseconds)


# Producer.


@pytest.mark.parametrize("period", [20, 50, 100])
def test_the_period_is_1017h(master: Master, period: int) -> None:
    master.write(1, 0x1017, 0, period)
    mark = master.mark()
    master.rest(0.5 + period / 1000)
    times = [frame.timestamp for frame in master.since(mark, 0x701)][1:]
    gaps = [b - a for a, b in zip(times, times[1:])]
    # The server's clock stamps the frames; 2 ms are for others on the bus and the host.
    assert statistics.median(gaps) == pytest.approx(period / 1000, abs=0.002)


def test_0_turns_the_heartbeat_off(master: Master) -> None:
    master.write(1, 0x1017, 0, 0)
    mark = master.mark()
    master.rest(0.3)
    assert not master.since(mark, 0x701)
    assert master.since(mark, 0x702)


@pytest.mark.parametrize(
    "command, state", [(START, OPERATIONAL), (STOP, STOPPED), (PRE_OPERATIONAL, PREOP)]
)
def test_the_heartbeat_tells_the_state(alone: Master, command: int, state: int) -> None:
    alone.write(1, 0x1017, 0, 20)
    mark = alone.mark()
    alone.nmt(command, 1)
    assert alone.next(0x701, mark, data=lambda data: data[0] == state)


# Consumer.


def test_supervision_begins_with_the_first_heartbeat(alone: Master) -> None:
    mark = alone.mark()
    watch(alone, 50)
    alone.rest(0.3)
    assert not alone.since(mark, 0x81)


def test_a_heartbeat_that_stops_is_8130h_and_one_that_comes_back_ends_it(
    plumb: Plumb, alone: Master
) -> None:
    watch(alone, 400)
    mark = alone.mark()
    # Another client sees when a heartbeat was on the bus: a busy machine may be late with one.
    with Master(plumb, ()) as witness:

        def beat() -> None:
            alone.send(0x700 + OTHER, bytes([OPERATIONAL]))

        def beats(count: int) -> list[float]:
            until(lambda: len(witness.since(0, 0x700 + OTHER)) == count, f"{count} heartbeats")
            return [frame.timestamp for frame in witness.since(0, 0x700 + OTHER)]

        def told() -> list[int]:
            return [int.from_bytes(f.data[:2], "little") for f in alone.since(mark, 0x81)]

        for _ in range(20):
            beat()
            time.sleep(0.04)
        sent = beats(20)
        until(lambda: alone.frames[-1].timestamp > sent[-1] + 0.4, "the end of their time")
        until(lambda: told()[-1:] == [HEARTBEAT_LOST], "8130h")
        for lost in alone.since(mark, 0x81):
            if int.from_bytes(lost.data[:2], "little") == HEARTBEAT_LOST:
                last = max(at for at in sent if at < lost.timestamp)
                assert lost.timestamp - last > 0.4 - 0.03, "none is lost before its time"
        assert lost.data[2] & 0x10, "error register: communication"
        assert alone.read(1, 0x1001) & 0x10
        assert alone.read(1, 0x1003, 1) & 0xFFFF == HEARTBEAT_LOST
        mark = alone.mark()
        beat()
        assert emcy(alone, mark, OVER).timestamp - beats(21)[-1] < 0.35


def test_the_time_runs_from_the_last_heartbeat(alone: Master) -> None:
    watch(alone, 200)
    mark = alone.mark()
    # The answers before and behind the heartbeat are stamped by the same clock as the EMCY.
    alone.read(1, 0x1001)
    alone.send(0x700 + OTHER, bytes([OPERATIONAL]))
    alone.read(1, 0x1001)
    lost = emcy(alone, mark, HEARTBEAT_LOST).timestamp
    before, behind = [frame.timestamp for frame in alone.since(mark, 0x581)]
    # 20 ms: how often the device looks at its faults.
    assert lost - before > 0.2 - 0.03 and lost - behind < 0.2 + 0.03


def test_the_other_channel_is_watched_as_delivered(master: Master) -> None:
    assert master.read(1, 0x1016, 1) == 2 << 16 | 500
    master.rest(0.3)
    mark = master.mark()
    master.write(2, 0x1017, 0, 0)
    emcy(master, mark, HEARTBEAT_LOST)


def test_the_same_node_twice_is_refused(alone: Master) -> None:
    watch(alone, 100, sub=2)
    entry = (OTHER << 16 | 100).to_bytes(4, "little")
    assert alone.refusal(1, 0x1016, 3, entry) == 0x0604_0043
    assert alone.read(1, 0x1016, 3) == 0


@pytest.mark.parametrize("entry", [128 << 16 | 100, 255 << 16 | 100, 100, OTHER << 16])
def test_an_entry_without_a_node_or_a_time_is_not_used(alone: Master, entry: int) -> None:
    data = entry.to_bytes(4, "little")
    for sub in (2, 3):
        assert alone.refusal(1, 0x1016, sub, data) == 0
        assert alone.read(1, 0x1016, sub) == entry
    mark = alone.mark()
    alone.send(0x700 + OTHER, bytes([OPERATIONAL]))
    alone.rest(0.4)
    assert not alone.since(mark, 0x81)
    for reserved in (1 << 24 | OTHER << 16 | 100, 0xFF << 24):
        assert alone.refusal(1, 0x1016, 2, reserved.to_bytes(4, "little")) == 0x0609_0030


# Guarding.


class Guard:
    """A master on the SLCAN port, since socketcand has no remote frames."""

    def __init__(self) -> None:
        channel = f"socket://127.0.0.1:{SLCAN}"
        self.bus = can.Bus(interface="slcan", channel=channel, sleep_after_open=0)

    def ask(self, node: int = 1, timeout: float = 20) -> int | None:
        """Sends the guarding request; the answer's byte, None if there is none."""
        while self.bus.recv(0.02) is not None:
            pass  # what is still on its way from before
        request = can.Message(
            arbitration_id=0x700 + node, is_extended_id=False, is_remote_frame=True, dlc=1
        )
        self.bus.send(request)
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            frame = self.bus.recv(0.05)
            if frame and frame.arbitration_id == 0x700 + node and not frame.is_remote_frame:
                return frame.data[0]
        return None


@pytest.fixture
def guard(alone: Master) -> Iterator[Guard]:
    """Node 1 has no heartbeat, so what comes under 701h is the answer to a guarding request."""
    alone.write(1, 0x1017, 0, 0)
    asking = Guard()
    yield asking
    asking.bus.shutdown()


def test_guarding_answers_with_a_bit_that_toggles(guard: Guard) -> None:
    assert [guard.ask() for _ in range(4)] == [PREOP, 0x80 | PREOP, PREOP, 0x80 | PREOP]


def test_guarding_tells_the_state(alone: Master, guard: Guard) -> None:
    assert guard.ask() == PREOP
    alone.nmt(START, 1)
    alone.settle()
    assert guard.ask() == 0x80 | OPERATIONAL
    alone.nmt(STOP, 1)
    alone.settle()
    assert guard.ask() == STOPPED


def test_a_reset_of_communication_starts_the_toggle_bit_anew(alone: Master, guard: Guard) -> None:
    assert guard.ask() == PREOP
    alone.reset(1, 0x82)
    alone.write(1, 0x1017, 0, 0)
    assert guard.ask() == PREOP


def test_a_node_with_a_heartbeat_is_not_guarded(alone: Master, guard: Guard) -> None:
    alone.write(1, 0x1017, 0, 60_000)
    assert guard.ask(timeout=0.5) is None


def test_a_master_that_guards_no_more_is_8130h(alone: Master, guard: Guard) -> None:
    alone.write(1, 0x100C, 0, 50)
    alone.write(1, 0x100D, 0, 3)
    mark = alone.mark()
    alone.rest(0.3)
    assert not alone.since(mark, 0x81), "it begins with the first request"
    guard.ask()
    lost = emcy(alone, mark, HEARTBEAT_LOST).timestamp
    # The answer is on the bus as soon as the request.
    asked = alone.next(0x701, mark).timestamp
    assert lost - asked == pytest.approx(0.15, abs=0.05)
    guard.ask()
    emcy(alone, mark, OVER)
