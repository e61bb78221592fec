"""The two channels together: the same instant, one judgement, and what a fault does to it."""

from __future__ import annotations

import math
import statistics
import time
from typing import Iterator

import pytest
from master import (
    INVALID16,
    INVALID32,
    MODE,
    PROOF_S,
    START,
    Master,
    Plumb,
    loosen,
    signed,
    slopes,
    unseen,
    until,
)

WAITING, AGREE, DISAGREE, OWN_FAULTY, OTHER_FAULTY, NONE_MEASURES = 0, 1, 6, 7, 8, 9
NOISE, SPIKES, BIASED, CORRUPT, SILENT, REFUSED, UNCONFIRMED = 10, 11, 13, 14, 15, 17, 18
DISAGREE_CODE, BIASED_CODE = 0xFF13, 0xFF08
OWN_CODE, OTHER_CODE, NONE_CODE = 0xFF14, 0xFF15, 0xFF16
DEGREES_24 = 360 / 2**24
# No sample since the estimator has begun anew, and an uncertainty that is too large.
LOOKS_FOR_VERTICAL = {1, 2}


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb("--speed", "5") as plumb:
        yield plumb


@pytest.fixture
def pair(plumb: Plumb, master: Master) -> Iterator[Master]:
    """Both nodes in OPERATIONAL with a SYNC every 20 ms, in agreement; whole again afterwards."""
    begin(master)
    yield master
    plumb.type("heal all", "power all on", "wire all on", "bus heal", "rate 90", "level")
    until(lambda: plumb.truth() == (0, 0), "the housing is level", 5)


def begin(master: Master) -> None:
    for node in (1, 2):
        master.write(node, 0x2050, 1, 50)
    master.nmt(START)
    for node in (1, 2):
        state(master, node, AGREE)
    master.rest(PROOF_S)


def state(master: Master, node: int, wanted: int, timeout: float = 8.0) -> None:
    until(lambda: master.read(node, 0x2021) == wanted, f"2021h = {wanted} of {node}", timeout)


def verdict(master: Master, node: int) -> list[int]:
    """Who is blamed, and why."""
    return [master.read(node, 0x2027, sub) for sub in (1, 2)]


def reasons(master: Master, node: int) -> list[int]:
    return [master.read(node, 0x2025, sub) for sub in (1, 2)]


def without_angle(master: Master, node: int, why: int) -> bool:
    """Both slopes are away for this reason; with a gyroscope perhaps since the estimator, which a
    fault makes begin anew, looks for the vertical."""
    found = reasons(master, node)
    # The two are read one after the other, and it may begin anew between them.
    return found == [why] * 2 or (MODE == "dynamic" and set(found) <= {why, *LOOKS_FOR_VERTICAL})


def newest(master: Master, node: int) -> bytes:
    """TPDO 1 of a SYNC that is still to come."""
    master.read(node, 0x1001)
    master.next(0x180 + node, master.mark())
    return bytes(master.next(0x180 + node, master.mark()).data)


def emcy(master: Master, mark: int, node: int, code: int, timeout: float = 8.0) -> bytes:
    """The first EMCY of a node with this code since the mark."""
    wanted = code.to_bytes(2, "little")
    found = master.next(0x80 + node, mark, timeout, lambda d: d[:2] == wanted)
    return bytes(found.data)


def fast_sync(master: Master, period_us: int) -> None:
    """Node 1 produces SYNC with this period, whatever the load of this machine."""
    master.write(1, 0x1006, 0, period_us)
    master.write(1, 0x1005, 0, 0x4000_0080)


def by_sync(master: Master, mark: int, identifiers: tuple[int, ...]) -> list[list[bytes]]:
    """What each SYNC since the mark has brought, where all of it came."""
    rounds: list[dict[int, bytes]] = []
    for frame in master.frames[mark:]:
        if frame.arbitration_id == 0x080:
            rounds.append({})
        elif rounds and frame.arbitration_id in identifiers:
            rounds[-1][frame.arbitration_id] = bytes(frame.data)
    return [[r[i] for i in identifiers] for r in rounds if len(r) == len(identifiers)]


def angle(data: bytes) -> tuple[float, float]:
    """Slope X and Y of an exchange frame, degrees."""
    return tuple(
        int.from_bytes(data[i : i + 3], "little", signed=True) * DEGREES_24 for i in (0, 3)
    )


def turn_at_80(plumb: Plumb, master: Master, goal: int) -> None:
    """Turns the housing, and waits until all that was sent meanwhile has been received."""
    plumb.type("rate 80", f"pitch {goal}")
    until(lambda: plumb.truth()[1] == goal, "the end of the turn", 10)
    # The answer comes behind everything before it, however late this machine is.
    master.read(1, 0x1001)


def crossing(plumb: Plumb, master: Master, goal: int) -> float:
    """Mean of A minus B while the housing turns through the middle at 80 deg/s, degrees."""
    mark = master.mark()
    turn_at_80(plumb, master, goal)
    pairs = [(angle(a)[1], angle(b)[1]) for a, b in by_sync(master, mark, (0x381, 0x382))]
    # The ends of the turn are left out, where it speeds up and slows down.
    turning = [(a, b) for a, b in pairs if abs(a) < 45]
    assert len(turning) > 150, "every SYNC has brought both"
    speed = abs(turning[-1][0] - turning[0][0]) / (len(turning) - 1) / 0.005
    assert speed == pytest.approx(80, abs=1), "it did turn at 80 deg/s"
    return statistics.mean(a - b for a, b in turning)


@pytest.mark.accelerometer("a gyroscope's scale differs from channel to channel, as skew does")
def test_both_report_the_same_instant_while_the_housing_turns(plumb: Plumb, pair: Master) -> None:
    """At 80 deg/s, 0.1 ms of skew between the nodes is 0.008 deg.

    What differs between the channels at rest is the same when turning back, while skew has the
    other sign then: half the difference of a turn there and one back is the skew alone. Noise
    leaves 50 us in that, and eight of them leave 18 us in their mean.
    """
    plumb.turn(-60)
    fast_sync(pair, 5000)
    there_and_back = [
        (crossing(plumb, pair, 60) - crossing(plumb, pair, -60)) / 2 / 80 for _ in range(8)
    ]
    skew = statistics.mean(there_and_back)
    noise = statistics.stdev(there_and_back) / math.sqrt(len(there_and_back))
    assert noise < 40e-6, f"too much noise to tell: {noise * 1e6:.0f} us"
    assert abs(skew) < 100e-6 + 2 * noise, f"{skew * 1e6:.0f} us, noise {noise * 1e6:.0f} us"


def test_tpdo_1_of_one_sync_agrees_during_motion(plumb: Plumb, pair: Master) -> None:
    plumb.turn(-45)
    fast_sync(pair, 10_000)
    mark = pair.mark()
    turn_at_80(plumb, pair, 45)
    rounds = by_sync(pair, mark, (0x181, 0x182))
    moving = [(signed(a)[1], signed(b)[1]) for a, b in rounds]
    moving = [(a, b) for a, b in moving if abs(a) < 4000]
    assert len(moving) > 60
    # A node that answered with its newest sample instead would be off by up to 2.5 ms: 0.2 deg.
    assert max(abs(a - b) for a, b in moving) <= 25
    assert statistics.mean(abs(a - b) for a, b in moving) <= 8
    assert [pair.read(node, 0x2021) for node in (1, 2)] == [AGREE, AGREE]


def test_the_difference_of_2024h_is_that_of_the_two_angles(pair: Master) -> None:
    """The larger one of X and Y. Where both are as large, the nodes may differ in which it is."""
    mark = pair.mark()
    until(lambda: len(by_sync(pair, mark, (0x281, 0x282))) >= 8, "eight differences of both")
    opposite = 0
    for a, b in by_sync(pair, mark, (0x281, 0x282)):
        (one,), (other,) = signed(a[5:7]), signed(b[5:7])
        assert INVALID16 not in (one, other) and abs(abs(one) - abs(other)) < 80
        opposite += abs(one + other) < 5
        assert a[0] & 0x3F == b[0] & 0x3F == 0x3F
    assert opposite > 4, "the same with the other sign"


def test_motion_is_no_fault(plumb: Plumb, pair: Master) -> None:
    mark = pair.mark()
    plumb.type("rate 120", "vibration 20", "pitch 60", "roll 20")
    until(lambda: plumb.truth() == (20, 60), "the pose", 5)
    plumb.type("level")
    until(lambda: plumb.truth() == (0, 0), "level", 5)
    plumb.type("vibration 0")
    assert not pair.since(mark, 0x081) and not pair.since(mark, 0x082)
    assert [pair.read(node, 0x2021) for node in (1, 2)] == [AGREE, AGREE]


@pytest.mark.parametrize(
    ("fault", "codes"),
    [("stuck", [0xFF01]), ("silent", [0xFF02, 0xFF01]), ("brown-out", [0x3200])],
)
def test_a_fault_of_b_is_told_by_both_and_stays_until_a_reset(
    plumb: Plumb, pair: Master, fault: str, codes: list[int]
) -> None:
    mark = pair.mark()
    plumb.type(f"fault b {fault}")
    for code in codes:
        emcy(pair, mark, 2, code)
    emcy(pair, mark, 2, OWN_CODE)
    emcy(pair, mark, 1, OTHER_CODE)
    faulty(pair)
    # A channel once found faulty stays isolated until it is reset.
    plumb.type("heal b")
    pair.rest(0.5)
    faulty(pair)
    recovered(pair)


@pytest.mark.parametrize(
    ("fault", "code", "bit", "why"),
    [
        ("frozen", 0xFF04, 17, 9),
        ("frozen x", 0xFF04, 17, 9),
        ("noise 10", 0xFF05, 18, 10),
        pytest.param(
            *("calibration", 0xFF21, 8, 14),
            marks=pytest.mark.virtual("a bit flips in the memory of a process"),
        ),
    ],
)
def test_what_a_channel_shows_of_itself_is_named(
    plumb: Plumb, pair: Master, fault: str, code: int, bit: int, why: int
) -> None:
    mark = pair.mark()
    plumb.type(f"fault b {fault}")
    assert int.from_bytes(emcy(pair, mark, 2, code)[3:6], "little") & 1 << bit
    emcy(pair, mark, 2, OWN_CODE)
    # The check sum is compared four times a second: a movement of B alone may be found before that.
    found = {why, BIASED} if why == CORRUPT else {why}
    told = emcy(pair, mark, 1, OTHER_CODE)[6:]
    assert told in [bytes([2 << 6 | reason, OTHER_FAULTY]) for reason in found]
    assert verdict(pair, 1) == [2, told[0] & 0x3F]
    blamed, own = verdict(pair, 2)
    assert blamed == 1 and own in found
    assert slopes(newest(pair, 2)) == [INVALID16] * 2
    assert any(without_angle(pair, 2, reason) for reason in found)
    assert newest(pair, 1)[4:] == bytes([0xC3, OTHER_FAULTY])


def test_spikes_of_one_channel_are_its_own(plumb: Plumb, pair: Master) -> None:
    mark = pair.mark()
    plumb.type("fault b spikes 500 3")
    emcy(pair, mark, 1, OTHER_CODE)
    # Where spikes fall into neighbouring looks they are told as noise.
    for node, channel in ((1, 2), (2, 1)):
        until(lambda: verdict(pair, node)[0] == channel, f"a verdict of node {node}")
        assert verdict(pair, node)[1] in (NOISE, SPIKES)


def faulty(master: Master) -> None:
    """B is faulty: B and A both report it, and A goes on measuring."""
    assert [master.read(node, 0x2021) for node in (2, 1)] == [OWN_FAULTY, OTHER_FAULTY]
    assert master.read(2, 0x2020) & 0x83 == 0x80, "no angle, and a latched fault"
    assert master.read(1, 0x2020) & 0x0F == 0x03, "its own angles alone"
    assert [master.read(node, 0x1001) & 0x81 for node in (1, 2)] == [0x81, 0x81]
    assert master.read(2, 0x6010) == INVALID16


def recovered(master: Master) -> None:
    """A reset of B is enough."""
    mark = master.mark()
    master.reset(2)
    master.nmt(START, 2)
    for node in (1, 2):
        state(master, node, AGREE)
        until(lambda: master.read(node, 0x1001) == 0, f"no error of node {node}")
    emcy(master, mark, 1, 0)


def test_an_invalid_angle_is_never_sent_as_a_plausible_number(plumb: Plumb, pair: Master) -> None:
    plumb.turn(30)
    mark = pair.mark()
    plumb.type("fault b silent")
    emcy(pair, mark, 2, 0xFF01)
    pair.rest(0.1)
    frames = [slopes(f.data) for f in pair.since(mark, 0x182)]
    for x, y in frames:
        assert (x, y) == (INVALID16, INVALID16) or (abs(x) < 30 and abs(y - 3000) < 30)
    assert frames[-1] == [INVALID16, INVALID16]
    exchange = pair.since(mark, 0x382)[-1].data
    assert 0 < exchange[6] < 32 and 0 < exchange[7] < 32, "reasons, not qualities"
    assert pair.read(1, 0x6820) == INVALID16


def test_without_its_power_the_other_channel_counts_as_faulty(plumb: Plumb, pair: Master) -> None:
    mark = pair.mark()
    plumb.type("power b off")
    emcy(pair, mark, 1, OTHER_CODE)
    emcy(pair, mark, 1, 0x8130)
    assert pair.read(1, 0x2021) == OTHER_FAULTY
    assert pair.read(1, 0x2020) & 0x3F == 0x03, "this one's angles, and no comparison"
    assert pair.read(1, 0x6810) == INVALID16
    plumb.type("power b on")
    pair.next(0x702, mark, data=lambda d: d == b"\0")
    pair.nmt(START, 2)
    state(pair, 1, AGREE, 8)


def test_without_any_channel_nobody_measures(plumb: Plumb, pair: Master) -> None:
    mark = pair.mark()
    plumb.type("fault a silent", "fault b silent")
    emcy(pair, mark, 1, NONE_CODE)
    emcy(pair, mark, 2, NONE_CODE)
    assert [pair.read(node, 0x2021) for node in (1, 2)] == [NONE_MEASURES] * 2


def test_a_loose_board_is_a_disagreement_that_accuses_nobody(
    plumb: Plumb, pair: Master
) -> None:
    """Level, gravity shows nothing of it, and nobody saw it move, so nobody can be named."""
    mark = pair.mark()
    loosen(plumb, pair)
    for node in (1, 2):
        told = emcy(pair, mark, node, DISAGREE_CODE)
        assert int.from_bytes(told[3:6], "little") == 1 << 12 and told[6:] == bytes([0, DISAGREE])
        assert pair.read(node, 0x2021) == DISAGREE
        assert verdict(pair, node) == [0, 0]
    unseen(plumb, pair, "heal b")
    pair.rest(0.5)
    assert pair.read(1, 0x2021) == DISAGREE, "latched until a reset"
    pair.reset()
    begin(pair)


def test_no_angle_counts_before_the_first_comparison(master: Master) -> None:
    assert INVALID16 not in [master.read(1, index) for index in (0x6010, 0x6020)], "to set it up"
    master.nmt(START, 1)
    mark = master.mark()
    for _ in range(3):
        master.sync()
        time.sleep(0.02)
    assert reasons(master, 1) == [UNCONFIRMED] * 2
    assert [master.read(1, index) for index in (0x6110, 0x6120)] == [INVALID32] * 2
    for frame in master.since(mark, 0x181):
        assert slopes(frame.data) == [INVALID16] * 2
        assert frame.data[4] & 0x3F == 0 and frame.data[5] == WAITING
    master.nmt(START, 2)
    master.compare()
    mark = master.mark()
    master.sync()
    for node in (1, 2):
        data = master.next(0x180 + node, mark).data
        assert all(abs(slope) < 30 for slope in slopes(data)), "level"
        assert data[4] & 0x3F == 0x3F and data[5] == AGREE
        assert reasons(master, node) == [0, 0]


def test_every_tpdo_1_carries_validity_and_state_with_its_angles(
    plumb: Plumb, pair: Master
) -> None:
    mark = pair.mark()
    newest(pair, 2)
    plumb.type("fault b brown-out")
    emcy(pair, mark, 1, OTHER_CODE)
    newest(pair, 1)
    seen = set()
    for node in (1, 2):
        for frame in pair.since(mark, 0x180 + node):
            x, y = slopes(frame.data)
            assert [x != INVALID16, y != INVALID16] == [bool(frame.data[4] & b) for b in (1, 2)]
            seen.add((node, frame.data[4] & 3, frame.data[5]))
    assert {(1, 3, AGREE), (2, 3, AGREE), (1, 3, OTHER_FAULTY), (2, 0, OWN_FAULTY)} <= seen
    assert {state for node, _, state in seen if node == 1} == {AGREE, OTHER_FAULTY}


def test_a_disagreement_takes_the_angles_of_both_away(plumb: Plumb, pair: Master) -> None:
    mark = pair.mark()
    loosen(plumb, pair)
    for node in (1, 2):
        emcy(pair, mark, node, DISAGREE_CODE)
    for node in (1, 2):
        data = newest(pair, node)
        assert slopes(data) == [INVALID16] * 2
        assert data[4] & 0x0F == 0 and data[5] == DISAGREE
        assert without_angle(pair, node, REFUSED)
        assert [pair.read(node, index) for index in (0x6110, 0x6120)] == [INVALID32] * 2
        assert [pair.read(node, index) for index in (0x6810, 0x6820)] == [INVALID16] * 2
        if MODE != "dynamic":
            assert pair.read(node, 0x2024, 1) != INVALID16, "by how much they differ is seen"
        until(lambda: 150 < abs(pair.read(node, 0x2028, 1)) < 250, "a residual of 20 mg")


def test_a_board_that_is_seen_to_move_is_named_level_too(plumb: Plumb, pair: Master) -> None:
    mark = pair.mark()
    plumb.type("fault b offset 20")
    for node in (1, 2):
        emcy(pair, mark, node, DISAGREE_CODE)
    emcy(pair, mark, 1, OTHER_CODE)
    assert emcy(pair, mark, 2, BIASED_CODE)[6] == 1 << 6 | BIASED
    assert [verdict(pair, node) for node in (1, 2)] == [[2, BIASED], [1, BIASED]]


def test_where_the_pose_tells_the_loose_board_is_named() -> None:
    """At 30 deg an offset along X and Y makes gravity longer, after a second at rest.

    A board of its own in real time: a minute of the bus later it is named as well, and A stays
    without an angle; a busy machine passes that soon where the bus is five times as fast.
    """
    with Plumb() as plumb, Master(plumb) as pair:
        begin(pair)
        mark = pair.mark()
        plumb.turn(30, 10)
        assert not pair.since(mark, 0x081) and not pair.since(mark, 0x082), "motion is no fault"
        plumb.type("fault b offset 20")
        for node in (1, 2):
            emcy(pair, mark, node, DISAGREE_CODE)
        emcy(pair, mark, 1, OTHER_CODE)
        emcy(pair, mark, 2, OWN_CODE)
        assert emcy(pair, mark, 2, BIASED_CODE)[6] == 1 << 6 | BIASED
        assert [verdict(pair, node) for node in (1, 2)] == [[2, BIASED], [1, BIASED]]
        alone = bytes([0xC3, OTHER_FAULTY])
        if MODE == "dynamic":
            # Both estimators began anew while the pair disagreed.
            until(lambda: newest(pair, 1)[4:] == alone, "A has its angles again", 20)
        else:
            assert newest(pair, 1)[4:] == alone
        assert slopes(newest(pair, 2)) == [INVALID16] * 2 and without_angle(pair, 2, BIASED)


def test_the_peers_stopping_is_noticed(pair: Master) -> None:
    mark = pair.mark()
    pair.nmt(0x80, 2)
    emcy(pair, mark, 1, OTHER_CODE)
    pair.nmt(START, 2)
    state(pair, 1, AGREE, 8)


# What is behind the angles of node 2, and how far it has turned: sent by it, received by node 1.
BEHIND = [(2, 0x1803, 0x482), (1, 0x1401, 0x482)]
TURN = [(2, 0x1806, 0x402), (1, 0x1402, 0x402)]


@pytest.mark.parametrize(
    ("node", "index", "identifier"),
    BEHIND + TURN * (MODE == "dynamic"),
    ids=lambda value: f"{value:X}",
)
def test_a_part_of_the_exchange_that_never_came_was_not_reported(
    pair: Master, node: int, index: int, identifier: int
) -> None:
    """Without it there are faults that no comparison shows."""

    def switch(off: int) -> None:
        # The product's data sheet does not have all of them.
        data = (identifier | off).to_bytes(4, "little")
        assert pair.refusal(node, index, 1, data) == 0

    mark = pair.mark()
    switch(1 << 31)
    emcy(pair, mark, 1, OTHER_CODE)
    assert verdict(pair, 1) == [2, SILENT]
    assert pair.read(1, 0x2020) & 0x3F == 0x03, "this one's angles, and no comparison"
    assert pair.read(2, 0x2021) == AGREE, "it receives all that it needs"
    switch(0)
    state(pair, 1, AGREE)


def test_single_lost_frames_are_no_fault(plumb: Plumb, pair: Master) -> None:
    mark = pair.mark()
    plumb.type("bus loss 0.02")
    plumb.rest(2)
    plumb.type("bus heal")
    codes = {bytes(f.data[:2]) for n in (0x081, 0x082) for f in pair.since(mark, n)}
    assert OTHER_CODE.to_bytes(2, "little") not in codes
    assert [pair.read(node, 0x2021) for node in (1, 2)] == [AGREE, AGREE]
