"""The paper's instrument on the bus: its chain, its tables, and Table I by what a master sees.

SYNC comes 50 times a second by the nodes' own time, which runs faster than this machine's, so times
are counted in SYNCs.
"""

from __future__ import annotations

import itertools
import math
from typing import Iterator

import pytest
from master import START, Master, Plumb, signed, until
from test_pair import fast_sync


AGREE, WARNING, STOP, DELAY, FAULT = 1, 2, 3, 4, 5
SPEED, HZ = 5, 50
STANDSTILL = 45 * HZ


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb("--mode", "paper", "--speed", str(SPEED)) as plumb:
        yield plumb


@pytest.fixture
def pair(plumb: Plumb, master: Master) -> Iterator[Master]:
    """Level and at work, 50 SYNCs a second, and the nodes agree."""
    plumb.turn(0, 0, 400)
    fast_sync(master, 1_000_000 // HZ)
    master.nmt(START)
    start = master.mark()
    for node in (1, 2):
        until(lambda: states(master, start, node)[-1:] == [AGREE], "agreement")
    yield master
    plumb.type("heal b")


def states(master: Master, mark: int, node: int = 1) -> list[int]:
    """The state of the pair in each TPDO 1 of a node since the mark."""
    return [frame.data[5] for frame in master.since(mark, 0x180 + node)]


def phases(master: Master, mark: int, node: int = 1) -> list[tuple[int, int]]:
    """The same as phases: the state, and how many SYNCs it has lasted."""
    groups = itertools.groupby(states(master, mark, node))
    return [(state, len(list(group))) for state, group in groups]


def swing(plumb: Plumb, master: Master, until_state: int, mark: int) -> None:
    """Turns to and fro at 40 deg/s until node 1 reports this."""
    goals = itertools.cycle((50, -50))
    plumb.type("rate 40")
    while until_state not in states(master, mark):
        plumb.type(f"pitch {next(goals)}")
        plumb.rest(0.3)


def test_it_is_the_paper_s_chain(pair: Master) -> None:
    for node in (1, 2):
        assert pair.read(node, 0x2062, 2) == 0, "a table for each axis"
        assert pair.read(node, 0x2023, 1) == 40_000, "the latency of one common instant, us"


def test_slopes_are_within_the_published_error(plumb: Plumb, pair: Master) -> None:
    errors = []
    for pitch, roll in ((30, 0), (-30, 0), (60, 0), (-60, 0), (0, 45), (0, -45)):
        plumb.turn(pitch, roll, 400)
        mark = pair.mark()
        until(lambda: len(states(pair, mark, 2)) > 4 * HZ, "two hundred SYNCs")
        for node in (1, 2):
            read = [signed(bytes(f.data[:4])) for f in pair.since(mark, 0x180 + node)][-HZ:]
            mean = [sum(axis) / len(axis) / 100 for axis in zip(*read)]
            errors += [mean[0] - roll, mean[1] - pitch]
    rmse = math.sqrt(sum(error**2 for error in errors) / len(errors))
    print(f"root mean square error {rmse:.3f} deg of {len(errors)} means")
    assert rmse < 0.11


def test_a_swing_at_80_deg_s_brought_warnings(plumb: Plumb, pair: Master) -> None:
    """Each node answered with its newest sample: up to 1.6 deg apart (erratum E11)."""
    mark = pair.mark()
    plumb.type("rate 80")
    for goal in (40, -40, 40, 0):
        plumb.type(f"pitch {goal}")
        until(lambda: plumb.truth()[1] == goal, "the end of the turn", 10)
    pair.settle()
    seen = states(pair, mark) + states(pair, mark, 2)
    assert len(seen) > 4 * HZ
    assert seen.count(AGREE) == len(seen), phases(pair, mark)


def test_late_data_stop_the_machine_for_45_s_and_work_goes_on(plumb: Plumb, pair: Master) -> None:
    """Table I, first row."""
    mark = pair.mark()
    plumb.type("fault b frames-late 410")
    swing(plumb, pair, STOP, mark)
    plumb.type("pitch 0")
    until(lambda: DELAY in states(pair, mark), "data delay", 30)
    before = list(itertools.takewhile(lambda phase: phase[0] != DELAY, phases(pair, mark)))
    assert before[-1][0] == STOP and before[-1][1] >= STANDSTILL, before
    warned = sum(count for state, count in before if state == WARNING)
    # A SYNC without a pair of its own shows the state of the one before.
    assert 110 <= warned < 125, before
    assert FAULT not in states(pair, mark)
    plumb.type("heal b")
    until(lambda: phases(pair, mark)[-1] > (AGREE, HZ), "agreement", 20)


def test_the_45_s_are_of_standstill(plumb: Plumb, pair: Master) -> None:
    """A machine that moved on was compared 45 s after it had been asked to stop."""
    mark = pair.mark()
    plumb.type("fault b frames-late 410")
    swing(plumb, pair, STOP, mark)
    moved = pair.mark()
    # 51 s of the bus.
    for goal in itertools.islice(itertools.cycle((50, -50)), round(51 / SPEED / 0.3)):
        plumb.type(f"pitch {goal}")
        plumb.rest(0.3)
    assert set(states(pair, moved)) == {STOP}
    plumb.type("pitch 0")
    until(lambda: plumb.truth()[1] == 0, "standstill")
    still = pair.mark()
    until(lambda: DELAY in states(pair, still), "data delay", 30)
    assert sum(1 for state in states(pair, still) if state == STOP) > STANDSTILL - HZ


def test_a_loose_board_is_a_physical_fault_until_a_reset(plumb: Plumb, pair: Master) -> None:
    """Table I, second row."""
    mark = pair.mark()
    plumb.type("fault b offset 20")
    until(lambda: FAULT in states(pair, mark), "a physical fault", 40)
    before = list(itertools.takewhile(lambda phase: phase[0] != FAULT, phases(pair, mark)))
    assert [state for state, _ in before if state != AGREE] == [WARNING, STOP], before
    assert before[-1][1] >= STANDSTILL
    plumb.type("heal b")
    pair.rest(1)
    assert states(pair, mark)[-1] == FAULT, "until a reset"
    pair.reset()
    for node in (1, 2):
        pair.write(node, 0x2050, 1, 0)
    mark = pair.mark()
    pair.nmt(START)
    fast_sync(pair, 1_000_000 // HZ)
    until(lambda: phases(pair, mark)[-1:] > [(AGREE, HZ)], "agreement", 20)
