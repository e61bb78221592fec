"""Four nodes on a bus without a free bit: nothing is lost that has a right to arrive.

Node 1 produces SYNC, so that the time between two of them doesn't depend on this machine.
"""

from __future__ import annotations

import itertools
import statistics
from typing import Iterator

import can
import pytest
from master import START, Master, Plumb, until

pytestmark = pytest.mark.virtual("one instrument is emulated, not two")

NODES = (1, 2, 3, 4)
SYNC, LOWEST, ABOVE_PDOS = 0x80, 0x7FF, 0x100
PERIOD_US = 10_000
OFF = 0x8000_0000
# TPDO 1, 3 and 4 come with every SYNC.
SYNCHRONOUS = (0x180, 0x380, 0x480)


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb("--instruments", "2") as plumb:
        yield plumb


@pytest.fixture
def master(plumb: Plumb) -> Iterator[Master]:
    """A master of four nodes in OPERATIONAL, in step with the SYNC of node 1, on a calm bus."""
    with Master(plumb, NODES) as master:
        plumb.type("babble off")
        master.reset()
        master.write(1, 0x1006, 0, PERIOD_US)
        master.write(1, 0x1005, 0, 0x4000_0080)
        master.nmt(START)
        for node in NODES:
            until(lambda: master.read(node, 0x2021) == 1, f"node {node} agrees with its peer", 5)
        yield master
        plumb.type("babble off")


def full(master: Master) -> bool:
    """Whether the nodes have seen a full bus for a second."""
    return master.read(1, 0x2052, 4) >= 99


def whole(master: Master, mark: int) -> list[list[can.Message]]:
    """The whole cycles since the mark: the frames of each, from SYNC to SYNC."""
    frames = master.frames[mark:]
    syncs = [at for at, frame in enumerate(frames) if frame.arbitration_id == SYNC]
    return [frames[a:b] for a, b in itertools.pairwise(syncs)]


def cycles(master: Master, mark: int, count: int) -> list[list[can.Message]]:
    """The first so many cycles since the mark; waits for them."""
    until(lambda: len(master.since(mark, SYNC)) > count, f"{count} SYNCs", 10)
    return whole(master, mark)[:count]


def last_sync(master: Master) -> int:
    """The mark of the newest SYNC: a flood may begin before the frames of its cycle are out."""
    frames = master.frames[: master.mark()]
    return max(at for at, frame in enumerate(frames) if frame.arbitration_id == SYNC)


def identifiers(cycle: list[can.Message]) -> list[int]:
    return [frame.arbitration_id for frame in cycle]


def incomplete(all_cycles: list[list[can.Message]]) -> dict[int, list[int]]:
    """The cycles in which a synchronous TPDO of any node is missing, or is there twice."""
    wanted = [base + node for base in SYNCHRONOUS for node in NODES]
    bad = {}
    for number, cycle in enumerate(all_cycles):
        seen = identifiers(cycle)
        if wrong := [pdo for pdo in wanted if seen.count(pdo) != 1]:
            bad[number] = wrong
    return bad


def overruns(master: Master) -> list[int]:
    return [master.read(node, 0x2052, 5) for node in NODES]


def test_a_full_bus_of_low_priority_loses_nothing(plumb: Plumb, master: Master) -> None:
    plumb.type(f"babble {LOWEST:X}")
    until(lambda: full(master), "100 % bus load", 5)
    before, mark = overruns(master), master.mark()
    seen = cycles(master, mark, 200)
    assert incomplete(seen) == {}
    # TPDO 2 comes with every tenth SYNC.
    slow = [i for cycle in seen for i in identifiers(cycle) if 0x281 <= i <= 0x284]
    assert all(slow.count(0x280 + node) == 20 for node in NODES)
    # The flood has every gap: at least one of its frames in nearly every cycle.
    assert sum(LOWEST in identifiers(cycle) for cycle in seen) > 150
    assert overruns(master) == before
    assert not [f for f in master.frames[mark:] if 0x81 <= f.arbitration_id <= 0x84]


def test_heartbeats_keep_their_time_on_a_full_bus(plumb: Plumb, master: Master) -> None:
    plumb.type(f"babble {LOWEST:X}")
    until(lambda: full(master), "100 % bus load", 5)
    mark = master.mark()
    for node in NODES:
        until(lambda: len(master.since(mark, 0x700 + node)) >= 6, "heartbeats", 5)
        times = [frame.timestamp for frame in master.since(mark, 0x700 + node)]
        gaps = [b - a for a, b in itertools.pairwise(times)]
        # A heartbeat waits for the frames of one cycle at most.
        assert all(abs(gap - 0.2) < 0.01 for gap in gaps), gaps


def test_both_pairs_go_on_comparing_on_a_full_bus(plumb: Plumb, master: Master) -> None:
    plumb.type(f"babble {LOWEST:X}")
    until(lambda: full(master), "100 % bus load", 5)
    missed = [master.read(node, 0x2026, 2) for node in NODES]
    cycles(master, master.mark(), 100)
    assert [master.read(node, 0x2021) for node in NODES] == [1, 1, 1, 1]
    assert [master.read(node, 0x2026, 2) for node in NODES] == missed


def test_sdo_works_on_a_full_bus(plumb: Plumb, master: Master) -> None:
    plumb.type(f"babble {LOWEST:X}")
    until(lambda: full(master), "100 % bus load", 5)
    for node in NODES:
        assert master.nodes[node].sdo.upload(0x1008, 0) == b"Plumb inclinometer"
        assert master.read(node, 0x1018, 4) > 0


def test_a_client_that_floods_loses_none_of_its_frames_nor_the_nodes_theirs(
    plumb: Plumb, master: Master
) -> None:
    count, mark, before = 3000, master.mark(), overruns(master)
    with can.Bus(
        interface="socketcand", host="127.0.0.1", port=plumb.port, channel="plumb"
    ) as flood:
        for number in range(count):
            data = number.to_bytes(8, "big")
            flood.send(can.Message(arbitration_id=LOWEST, data=data, is_extended_id=False))
        until(lambda: len(master.since(mark, LOWEST)) == count, "every frame", 20)
    came = [int.from_bytes(frame.data, "big") for frame in master.since(mark, LOWEST)]
    assert came == list(range(count))
    # It takes more than a second, or the bus was not full.
    seen = cycles(master, mark, 100)
    assert incomplete(seen) == {}
    assert overruns(master) == before


def test_beside_a_client_that_floods_another_is_served_in_turn(
    plumb: Plumb, master: Master
) -> None:
    """It waited two seconds, for all that the other had sent before."""
    # A machine that does not run this process for a while sees no more than the end of a flood.
    assert any(served_in_turn(plumb, master) for _ in range(5))


def served_in_turn(plumb: Plumb, master: Master) -> bool:
    """Whether a client is answered while another one's frames wait, by the frames between."""
    count, mark = 3000, master.mark()
    with can.Bus(
        interface="socketcand", host="127.0.0.1", port=plumb.port, channel="plumb"
    ) as flood:
        frame = can.Message(arbitration_id=LOWEST, data=bytes(8), is_extended_id=False)
        for _ in range(count):
            flood.send(frame)
        waited = []
        for _ in range(20):
            asked = master.mark()
            master.read(1, 0x1018, 4)
            waited.append(master.frames[-1].timestamp - master.frames[asked - 1].timestamp)
        goes_on = len(master.since(mark, LOWEST)) < count
        until(lambda: len(master.since(mark, LOWEST)) == count, "every frame", 20)
    return goes_on and statistics.median(waited) < 0.05


def test_a_flood_above_the_pdos_delays_them_and_counts_what_was_replaced(
    plumb: Plumb, master: Master
) -> None:
    for node in NODES:
        # Without TPDO 2 there are three TPDOs for each SYNC, to be found again one by one.
        master.write(node, 0x1801, 1, OFF | 0x280 + node)
    before, mark = overruns(master), last_sync(master)
    plumb.type(f"babble {ABOVE_PDOS:X}")
    until(lambda: len(master.since(mark, ABOVE_PDOS)) > 400, "a fifth of a second of flood", 10)
    plumb.type("babble off")

    def calm() -> bool:
        last = whole(master, mark)[-12:]
        return len(last) == 12 and not any(ABOVE_PDOS in identifiers(cycle) for cycle in last)

    until(calm, "twelve cycles without the flood", 10)
    seen = whole(master, mark)
    lost = [after - first for after, first in zip(overruns(master), before, strict=True)]
    for node, counted in zip(NODES, lost, strict=True):
        sent = sum(identifiers(cycle).count(pdo + node) for cycle in seen for pdo in SYNCHRONOUS)
        assert sent + counted == 3 * len(seen), (node, sent, counted)
    # The first cycle still brings what came late; after it each one is whole again.
    assert incomplete(seen[-10:]) == {}
    for node in NODES:
        until(lambda: master.read(node, 0x2021) == 1, f"node {node} agrees again")
