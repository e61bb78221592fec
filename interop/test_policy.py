"""What a machine builder decides: how long a fault stays (2004h), whether one channel may do
alone (2005h), and who judges (2003h)."""

from __future__ import annotations

from typing import Iterator

import pytest
from master import (
    INVALID16,
    INVALID32,
    PRE_OPERATIONAL,
    PROOF_S,
    START,
    Master,
    Plumb,
    loosen,
    slopes,
    until,
)

WAITING, AGREE, WARNING, DISAGREE, OWN_FAULTY, OTHER_FAULTY = 0, 1, 2, 6, 7, 8
DISAGREE_CODE, OWN_CODE, OTHER_CODE, SUPPLY = 0xFF13, 0xFF14, 0xFF15, 0x3200
PEER, SET_UP_LOST, SILENT, UNCONFIRMED, ALONE = 2, 7, 15, 18, 19
LATCHED = 0x80
TOO_HIGH, READ_ONLY = 0x0609_0031, 0x0601_0002
SPEED = 5


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb("--speed", str(SPEED)) as plumb:
        yield plumb


@pytest.fixture
def pair(plumb: Plumb, master: Master) -> Iterator[Master]:
    """Both nodes in OPERATIONAL with a SYNC every 20 ms, in agreement; whole again afterwards."""
    begin(master)
    yield master
    plumb.type("heal all", "power all on", "wire all on")


def begin(master: Master) -> None:
    for node in (1, 2):
        master.write(node, 0x2050, 1, 50)
    master.nmt(START)
    both(master, AGREE, AGREE)
    master.rest(PROOF_S)


def both(master: Master, *wanted: int) -> None:
    """Waits for the state of the pair as each node sees it."""
    for node, state in enumerate(wanted, 1):
        until(lambda: master.read(node, 0x2021) == state, f"2021h = {state} of {node}", 12)


def latch(master: Master, seconds: int) -> None:
    for node in (1, 2):
        master.write(node, 0x2004, 0, seconds)


def emcy(master: Master, mark: int, node: int, code: int) -> bytes:
    """The first EMCY of a node with this code since the mark."""
    wanted = code.to_bytes(2, "little")
    return bytes(master.next(0x80 + node, mark, 12, lambda d: d[:2] == wanted).data)


def newest(master: Master, node: int) -> bytes:
    """TPDO 1 of a SYNC that is still to come."""
    master.read(node, 0x1001)
    mark = master.mark()
    master.next(0x180 + node, mark)
    return bytes(master.next(0x180 + node, master.mark()).data)


def reasons(master: Master, node: int) -> list[int]:
    return [master.read(node, 0x2025, sub) for sub in (1, 2)]


def verdict(master: Master, node: int) -> list[int]:
    """Who is blamed, and why."""
    return [master.read(node, 0x2027, sub) for sub in (1, 2)]


def test_as_delivered_faults_stay_and_one_channel_may_do_alone(master: Master) -> None:
    assert [master.read(1, index) for index in (0x2003, 0x2004, 0x2005)] == [0, 0, 1]


def test_what_is_no_policy_is_refused(master: Master) -> None:
    assert master.refusal(1, 0x2003, 0, b"\x02") == READ_ONLY, "there is one rule"
    assert master.refusal(1, 0x2004, 0, (3601).to_bytes(2, "little")) == TOO_HIGH
    assert master.refusal(1, 0x2005, 0, b"\x02") == TOO_HIGH
    assert [master.read(1, index) for index in (0x2003, 0x2004, 0x2005)] == [0, 0, 1]


def alone(master: Master, allowed: bool) -> None:
    """A is left alone: it works on, or reports that it may not."""
    data = newest(master, 1)
    assert data[5] == OTHER_FAULTY
    if allowed:
        assert data[4] & 0x3F == 0x03, "its own angles, no comparison"
        assert all(abs(slope) < 30 for slope in slopes(data)), "level"
        assert reasons(master, 1) == [0, 0]
    else:
        assert data[4] & 0x3F == 0
        assert slopes(data) == [INVALID16] * 2
        assert reasons(master, 1) == [ALONE] * 2
        assert [master.read(1, i) for i in (0x6110, 0x6120)] == [INVALID32] * 2


def test_a_supply_fault_of_b_leaves_a_working_unless_that_is_forbidden(
    plumb: Plumb, pair: Master
) -> None:
    mark = pair.mark()
    plumb.type("fault b supply")
    assert emcy(pair, mark, 1, OTHER_CODE)[7] == OTHER_FAULTY
    assert emcy(pair, mark, 2, OWN_CODE)[7] == OWN_FAULTY
    assert verdict(pair, 1)[0] == PEER
    alone(pair, allowed=True)
    pair.write(1, 0x2005, 0, 0)
    alone(pair, allowed=False)
    pair.write(1, 0x2005, 0, 1)
    alone(pair, allowed=True)
    assert slopes(newest(pair, 2)) == [INVALID16] * 2


def test_without_b_s_power_a_alone_is_invalid_where_it_may_not_do(
    plumb: Plumb, pair: Master
) -> None:
    pair.write(1, 0x2005, 0, 0)
    plumb.type("power b off")
    both(pair, OTHER_FAULTY)
    assert verdict(pair, 1) == [PEER, SILENT]
    alone(pair, allowed=False)
    plumb.type("power b on")


@pytest.mark.parametrize("degraded", [1, 0])
def test_a_node_whose_peer_never_speaks_has_no_angle(master: Master, degraded: int) -> None:
    """The peer may still be starting, so it has two seconds; without it nothing was compared."""
    master.write(1, 0x2005, 0, degraded)
    master.write(1, 0x2050, 1, 50)
    mark = master.mark()
    master.nmt(START, 1)
    both(master, OTHER_FAULTY)
    newest(master, 1)
    frames = master.since(mark, 0x181)
    first = next(f.timestamp for f in frames if f.data[5] == OTHER_FAULTY)
    assert first - frames[0].timestamp == pytest.approx(2.0, abs=0.2)
    for frame in frames:
        assert frame.data[5] in (WAITING, OTHER_FAULTY)
        assert slopes(frame.data) == [INVALID16] * 2 and frame.data[4] & 3 == 0
    assert reasons(master, 1) == [UNCONFIRMED] * 2
    assert verdict(master, 1) == [PEER, UNCONFIRMED]


def test_an_offset_from_before_the_start_was_shown_as_an_angle_when_b_had_no_power(
    plumb: Plumb, master: Master
) -> None:
    plumb.type("power b off", "fault a bias x 100")
    plumb.truth()
    master.reset(1)
    master.write(1, 0x2050, 1, 50)
    mark = master.mark()
    master.nmt(START, 1)
    both(master, OTHER_FAULTY)
    newest(master, 1)
    frames = master.since(mark, 0x181)
    assert all(slopes(frame.data) == [INVALID16] * 2 for frame in frames)
    mark = master.mark()
    plumb.type("heal a", "power b on")
    master.next(0x702, mark, data=lambda d: d == b"\0")


def heal_after(plumb: Plumb, master: Master, node: int) -> float:
    """Heals; the virtual time until the node takes its fault back."""
    master.read(node, 0x1001)
    mark, since = master.mark(), master.frames[-1].timestamp
    plumb.type("heal all")
    # Emulated boards on a loaded machine are slower than they should be here.
    wanted = master.next(0x80 + node, mark, 30, lambda d: d[:6] == bytes(6))
    return wanted.timestamp - since


def test_a_disagreement_is_over_once_the_channels_have_agreed_for_2004h(
    plumb: Plumb, pair: Master
) -> None:
    latch(pair, 3)
    mark = pair.mark()
    loosen(plumb, pair)
    for node in (1, 2):
        emcy(pair, mark, node, DISAGREE_CODE)
    both(pair, DISAGREE, DISAGREE)
    assert [pair.read(node, 0x2020) & LATCHED for node in (1, 2)] == [0, 0], "it passes by itself"
    mark = pair.mark()
    after = heal_after(plumb, pair, 1)
    told = [bytes(f.data).hex() for f in pair.since(mark, 0x081)]
    assert 2.9 < after < 6, told
    both(pair, AGREE, AGREE)
    for node in (1, 2):
        assert newest(pair, node)[4] & 0x3F == 0x3F


def test_a_disagreement_stays_while_it_lasts_whatever_2004h_sets(
    plumb: Plumb, pair: Master
) -> None:
    latch(pair, 1)
    mark = pair.mark()
    loosen(plumb, pair)
    emcy(pair, mark, 1, DISAGREE_CODE)
    pair.rest(5 / SPEED)
    both(pair, DISAGREE, DISAGREE)
    codes = [bytes(f.data[:2]) for f in pair.since(mark, 0x081)]
    assert codes == [DISAGREE_CODE.to_bytes(2, "little")]


def test_a_sensor_that_lost_its_set_up_gets_it_again_after_2004h(
    plumb: Plumb, pair: Master
) -> None:
    latch(pair, 2)
    mark = pair.mark()
    plumb.type("fault b brown-out")
    emcy(pair, mark, 2, SUPPLY)
    emcy(pair, mark, 1, OTHER_CODE)
    both(pair, OTHER_FAULTY, OWN_FAULTY)
    # The samples stop at once; why they did shows when the registers are next read back.
    until(lambda: verdict(pair, 1) == [PEER, SET_UP_LOST], "a set-up that was lost")
    assert [pair.read(node, 0x2020) & LATCHED for node in (1, 2)] == [0, 0]
    both(pair, AGREE, AGREE)
    for node in (1, 2):
        until(lambda: pair.read(node, 0x1001) == 0, f"no error of node {node}")
        assert newest(pair, node)[4] & 0x3F == 0x3F


def test_latched_is_reported_by_both_until_the_faulty_one_is_reset(
    plumb: Plumb, pair: Master
) -> None:
    plumb.type("fault b brown-out")
    both(pair, OTHER_FAULTY, OWN_FAULTY)
    assert [newest(pair, node)[4] & LATCHED for node in (1, 2)] == [LATCHED, LATCHED]
    pair.reset(1)
    pair.nmt(START, 1)
    both(pair, OTHER_FAULTY, OWN_FAULTY)
    pair.reset(2)
    begin(pair)
    assert [newest(pair, node)[4] & LATCHED for node in (1, 2)] == [0, 0]


def test_a_channel_that_was_only_silent_is_back_after_a_second(
    plumb: Plumb, pair: Master
) -> None:
    assert pair.read(1, 0x2004) == 0, "even where faults stay until a reset"
    plumb.type("wire b off")
    both(pair, OTHER_FAULTY)
    assert verdict(pair, 1) == [PEER, SILENT]
    assert pair.read(1, 0x2020) & LATCHED == 0
    mark = pair.mark()
    plumb.type("wire b on")
    both(pair, AGREE, AGREE)
    newest(pair, 1)
    heard = pair.next(0x382, mark).timestamp
    back = next(f for f in pair.since(mark, 0x181) if f.data[5] == AGREE).timestamp
    assert 0.9 < back - heard < 3


def test_silence_counts_after_three_syncs(plumb: Plumb, pair: Master) -> None:
    pair.write(1, 0x1006, 0, 100_000)
    pair.write(1, 0x1005, 0, 0x4000_0080)
    for node in (1, 2):
        pair.write(node, 0x2050, 1, 0)
    pair.rest(0.2)
    mark = pair.mark()
    pair.nmt(PRE_OPERATIONAL, 2)
    told = pair.next(0x081, mark, data=lambda d: d[:2] == OTHER_CODE.to_bytes(2, "little"))
    last = [f for f in pair.frames if f.arbitration_id == 0x382 and f.timestamp < told.timestamp]
    syncs = [f for f in pair.since(0, 0x080) if last[-1].timestamp < f.timestamp < told.timestamp]
    # A SYNC tells that the one before it has gone unanswered: the fourth has three behind it.
    assert len(syncs) == 4
