"""SYNC: taken, produced and counted (CiA 301, 7.2.5), and made by a node when nobody does."""

from __future__ import annotations

import time
from typing import Iterator

import pytest
from master import PRE_OPERATIONAL, START, STOP, Master, Plumb, gaps, until

PRODUCE = 0x4000_0000
BAD_VALUE, WRONG_STATE = 0x0609_0030, 0x0800_0022


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb() as plumb:
        yield plumb


def produce(master: Master, node: int, period_us: int) -> int:
    """Makes a node the producer of SYNC; returns the mark from before."""
    master.write(node, 0x1006, 0, period_us)
    mark = master.mark()
    master.write(node, 0x1005, 0, PRODUCE | 0x80)
    return mark


def test_a_node_produces_sync_on_demand_with_the_period_of_1006h(master: Master) -> None:
    mark = produce(master, 2, 10_000)
    master.rest(0.5)
    found = gaps(master.since(mark, 0x080))
    assert len(found) > 30
    # A heartbeat on the bus delays SYNC by 400 us at most; the mean is the clock of the node.
    assert all(abs(gap - 0.010) < 0.0012 for gap in found), found
    assert sum(found) / len(found) == pytest.approx(0.010, abs=0.0001)
    master.write(2, 0x1005, 0, 0x80)
    mark = master.mark()
    master.rest(0.1)
    assert not master.since(mark, 0x080)


def test_the_producer_obeys_its_own_sync(master: Master) -> None:
    mark = produce(master, 1, 20_000)
    master.nmt(START)
    master.rest(0.3)
    count = len(master.since(mark, 0x080))
    assert len(master.since(mark, 0x181)) >= count - 6
    assert master.read(1, 0x2026, 3) == 2 and master.read(2, 0x2026, 3) == 1


def test_a_stopped_node_produces_no_sync(master: Master) -> None:
    produce(master, 1, 10_000)
    master.nmt(STOP, 1)
    master.rest(0.05)
    mark = master.mark()
    master.rest(0.1)
    assert not master.since(mark, 0x080)
    master.nmt(PRE_OPERATIONAL, 1)
    master.next(0x080, mark)


def test_the_counter_runs_from_1_to_its_overflow(master: Master) -> None:
    for node in (1, 2):
        master.write(node, 0x1019, 0, 4)
    mark = produce(master, 1, 10_000)
    master.rest(0.2)
    found = [f.data[0] for f in master.since(mark, 0x080)]
    assert found[:9] == [1, 2, 3, 4, 1, 2, 3, 4, 1]


def test_a_tpdo_begins_at_its_sync_start_value(master: Master) -> None:
    master.write(1, 0x1019, 0, 10)
    master.write(1, 0x1800, 1, 0x8000_0181)
    master.write(1, 0x1800, 2, 2)
    master.write(1, 0x1800, 6, 3)
    master.write(1, 0x1800, 1, 0x181)
    master.nmt(START, 1)
    seen = []
    for counter in (1, 2, 3, 4, 5, 6):
        mark = master.mark()
        master.sync(counter)
        # The answer comes behind the PDO of this SYNC, however late this machine is.
        master.read(1, 0x1001)
        seen.append(len(master.since(mark, 0x181)))
    assert seen == [0, 0, 1, 0, 1, 0]


@pytest.mark.parametrize(("overflow", "counter"), [(0, 1), (4, None)])
def test_a_sync_of_a_wrong_length_is_reported_and_not_obeyed(
    master: Master, overflow: int, counter: int | None
) -> None:
    master.write(1, 0x1019, 0, overflow)
    master.nmt(START, 1)
    before = master.read(1, 0x2026, 1)
    mark = master.mark()
    master.sync(counter)
    assert int.from_bytes(master.next(0x081, mark).data[:2], "little") == 0x8240
    assert master.read(1, 0x2026, 1) == before
    assert not master.since(mark, 0x181)


def test_what_1005h_1006h_and_1019h_cannot_be_is_refused(master: Master) -> None:
    for bad in (1, 241, 255):
        assert master.refusal(1, 0x1019, 0, bytes([bad])) in (BAD_VALUE, 0x0609_0031), bad
    for bad in (0x000, 0x101, 0x581, 0x601, 0x701, 0x2000_0080):
        assert master.refusal(1, 0x1005, 0, bad.to_bytes(4, "little")) == BAD_VALUE, bad
    produce(master, 1, 20_000)
    # CiA 301: the counter is fixed while a period is set, the identifier while SYNC is produced.
    assert master.refusal(1, 0x1019, 0, b"\x04") == WRONG_STATE
    assert master.refusal(1, 0x1005, 0, (PRODUCE | 0x90).to_bytes(4, "little")) == BAD_VALUE
    assert master.read(1, 0x1005) == PRODUCE | 0x80


def test_every_sync_of_another_identifier_is_obeyed_after_1005h_is_changed(master: Master) -> None:
    master.write(1, 0x1005, 0, 0x90)
    before = master.read(1, 0x2026, 1)
    master.sync()
    master.send(0x90)
    master.send(0x90)
    assert master.read(1, 0x2026, 1) == before + 2


def test_the_lower_node_id_makes_sync_when_nobody_does(master: Master) -> None:
    for node in (1, 2):
        master.write(node, 0x2050, 1, 500)
    mark = master.mark()
    master.nmt(START)
    # The answer is on the bus before the SYNC is.
    master.read(1, 0x1001)
    begun = master.since(mark, 0x581)[-1].timestamp
    master.sync()
    until(lambda: len(master.since(mark, 0x080)) > 20, "20 SYNCs")
    made = [frame.timestamp for frame in master.since(mark, 0x080)]
    assert made[0] - begun > 0.5, "the time-out is 500 ms"
    assert made[20] - made[0] == pytest.approx(20 * 0.020, abs=0.0024)
    assert gaps(master.since(mark, 0x080))[5] == pytest.approx(0.020, abs=0.0012)
    assert [master.read(node, 0x2026, 3) for node in (1, 2)] == [2, 1]


def test_a_node_that_is_not_operational_makes_no_sync_of_its_own_accord(master: Master) -> None:
    for node in (1, 2):
        master.write(node, 0x2050, 1, 50)
    mark = master.mark()
    master.rest(0.3)
    assert not master.since(mark, 0x080)


def test_a_sync_of_the_master_ends_the_fallback(master: Master) -> None:
    # Long beside what a busy machine may be late with a SYNC.
    for node in (1, 2):
        master.write(node, 0x2050, 1, 4000)
    mark = master.mark()
    master.nmt(START)
    master.next(0x080, mark)
    for _ in range(3):
        master.sync()
        time.sleep(0.03)
    # What the fallback has sent before it ended has been received.
    master.settle()
    mark = master.mark()
    for _ in range(10):
        master.sync()
        time.sleep(0.03)
    assert not master.since(mark, 0x080), "two producers"
    assert [master.read(node, 0x2026, 3) for node in (1, 2)] == [1, 1]


def test_the_other_node_takes_over_after_twice_the_time(plumb: Plumb, master: Master) -> None:
    for node in (1, 2):
        master.write(node, 0x2050, 1, 200)
    master.nmt(START)
    mark = master.mark()
    master.next(0x080, mark)
    plumb.type("power a off")

    def longest() -> float:
        return max(gaps(master.since(mark, 0x080)), default=0.0)

    until(lambda: longest() > 0.1, "another producer")
    assert longest() > 0.39, "twice 200 ms"
    assert master.read(2, 0x2026, 3) == 2
    plumb.type("power a on")
    master.next(0x701, mark, data=lambda d: d == b"\0")
