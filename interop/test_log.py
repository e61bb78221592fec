"""The fault log (2070h) and the black box (2071h), by the formats of docs/canopen.md."""

from __future__ import annotations

import itertools
import statistics
import struct
from typing import Iterator, NamedTuple

import canopen
import pytest
from master import PRE_OPERATIONAL, START, Master, Plumb, gaps, until

NO_DATA, CANNOT_STORE, WRONG_STATE = 0x0800_0024, 0x0800_0020, 0x0800_0022
CLEAR = int.from_bytes(b"clea", "little")
NOBODY, OWN, PEER = 0, 1, 2
# Before a brown-out is seen in the part's set-up its samples stop.
STOPPED, SET_UP_LOST = 3, 7
SUPPLY, DISAGREE_CODE, OWN_CODE, OTHER_CODE, RANGE_Y = 0x3200, 0xFF13, 0xFF14, 0xFF15, 0x5020
AGREE, DISAGREE, OWN_FAULTY, OTHER_FAULTY = 1, 6, 7, 8
BEFORE, AFTER = 32, 16
PERIOD_US = 20_000
SPEED = 4


class Entry(NamedTuple):
    """An event."""

    at_ms: int
    sync: int
    code: int
    faults: int
    state: int
    blamed: int
    reason: int
    box: int
    repeats: int


class Frame(NamedTuple):
    """What both channels said at a SYNC: TPDO 3 and 4 of each."""

    own: tuple[bytes, bytes]
    peer: tuple[bytes, bytes]
    state: int
    blamed: int
    reason: int


class Box(NamedTuple):
    """The samples around an event."""

    event: Entry
    period_us: int
    before: list[Frame]
    after: list[Frame]


def entry(data: bytes) -> Entry:
    return Entry(*struct.unpack("<IIHIBBBBH", data))


def frame(data: bytes) -> Frame:
    a, b, c, d = (data[at : at + 8] for at in (0, 8, 16, 24))
    return Frame((a, b), (c, d), data[32], data[33] >> 6, data[33] & 0x3F)


def read_log(master: Master, node: int) -> list[Entry]:
    """All entries, newest first."""
    data = upload(master, node, 0x2070, 0)
    version, length, count, _ = data[:4]
    assert (version, length) == (1, 20) and len(data) == 4 + 20 * count
    return [entry(data[4 + 20 * n : 24 + 20 * n]) for n in range(count)]


def read_box(master: Master, node: int, number: int) -> Box:
    """A box."""
    data = upload(master, node, 0x2071, number)
    version, length, before, after, period_us = struct.unpack("<BBBBI", data[:8])
    assert (version, length) == (1, 34) and len(data) == 28 + 34 * (before + after)
    frames = [frame(data[28 + 34 * n : 62 + 34 * n]) for n in range(before + after)]
    return Box(entry(data[8:28]), period_us, frames[:before], frames[before:])


def upload(master: Master, node: int, index: int, sub: int) -> bytes:
    """By block transfer, which checks the CRC."""
    sdo = master.nodes[node].sdo
    with sdo.open(index, sub, "rb", block_transfer=True) as stream:
        return stream.read()


def is_empty(master: Master, node: int, number: int) -> bool:
    """Whether a box reports that there is nothing in it."""
    try:
        master.nodes[node].sdo.upload(0x2071, number)
    except canopen.SdoAbortedError as abort:
        assert abort.code == NO_DATA
        return True
    return False


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb("--speed", str(SPEED)) as plumb:
        yield plumb


@pytest.fixture
def pair(plumb: Plumb, joined: Master) -> Iterator[Master]:
    """Both nodes with nothing to tell, in OPERATIONAL and in agreement, SYNC made by node 1."""
    plumb.type("heal all")
    power_cycle(plumb, joined, "all", (1, 2))
    for node in (1, 2):
        joined.write(node, 0x2072, 0, CLEAR)
    joined.reset()
    joined.write(1, 0x1006, 0, PERIOD_US)
    joined.write(1, 0x1005, 0, 0x4000_0080)
    joined.nmt(START)
    agreed(joined)
    yield joined
    plumb.type("heal all")


def power_cycle(plumb: Plumb, master: Master, who: str, nodes: tuple[int, ...]) -> None:
    # The end of a block transfer has no answer: a node would get it when it is on again.
    master.settle()
    plumb.type(f"power {who} off")
    plumb.rest(0.2)
    mark = master.mark()
    plumb.type(f"power {who} on")
    for node in nodes:
        master.next(0x700 + node, mark, data=lambda d: d == b"\0")


def agreed(master: Master) -> None:
    for node in (1, 2):
        until(lambda: master.read(node, 0x2021) == AGREE, f"agreement of node {node}", 10)


def break_b(plumb: Plumb, master: Master, trouble: str = "brown-out") -> int:
    """Something happens to B; waits until the box of A is full. The mark from before."""
    mark = master.mark()
    plumb.type(f"fault b {trouble}")
    for node in (1, 2):
        master.next(0x80 + node, mark, data=lambda d: d[6] or d[7] == DISAGREE)
    wait_for_syncs(master, AFTER + 4)
    return mark


def wait_for_syncs(master: Master, count: int) -> None:
    mark = master.mark()
    until(lambda: len(master.since(mark, 0x080)) >= count, f"{count} SYNCs", 10)


def told(master: Master, mark: int, node: int) -> list[tuple[int, int, int, int, int]]:
    """Code, faults, state, blamed channel and reason of each EMCY since the mark."""
    found = []
    for message in master.since(mark, 0x80 + node):
        code, _, low, high, blame, state = struct.unpack("<HBHBBB", message.data)
        found.append((code, low | high << 16, state, blame >> 6, blame & 0x3F))
    return found


def test_a_fresh_instrument_has_nothing_to_tell(pair: Master) -> None:
    for node in (1, 2):
        assert upload(pair, node, 0x2070, 0) == bytes([1, 20, 0, 0])
        assert is_empty(pair, node, 1) and is_empty(pair, node, 2)


def test_the_log_tells_what_emcy_told(plumb: Plumb, pair: Master) -> None:
    mark = break_b(plumb, pair)
    for node, blamed, state in ((1, PEER, OTHER_FAULTY), (2, OWN, OWN_FAULTY)):
        log = read_log(pair, node)
        events = [(e.code, e.faults, e.state, e.blamed, e.reason) for e in reversed(log)]
        assert events == told(pair, mark, node)
        assert log[0][4:6] == (state, blamed) and log[0].reason in (STOPPED, SET_UP_LOST)
        assert [e.at_ms for e in log] == sorted((e.at_ms for e in log), reverse=True)
    assert {e.code for e in read_log(pair, 1)} == {OTHER_CODE}
    assert {SUPPLY, OWN_CODE} <= {e.code for e in read_log(pair, 2)}


def test_times_and_syncs_of_an_event_are_the_nodes_own(plumb: Plumb, pair: Master) -> None:
    before = pair.read(1, 0x2026, 1)
    break_b(plumb, pair)
    (event,) = read_log(pair, 1)
    assert before < event.sync < pair.read(1, 0x2026, 1)
    # The verdict came with the event, and has another reason since the lost set-up was seen.
    later_ms = pair.read(1, 0x2027, 3) - event.at_ms
    assert 0 <= later_ms <= 3 * PERIOD_US // 1000, "when the verdict came"


def test_by_segments_it_is_the_same_as_by_blocks(plumb: Plumb, pair: Master) -> None:
    break_b(plumb, pair)
    for node, index, sub in itertools.product((1, 2), (0x2070, 0x2071), (0, 1)):
        if (index, sub) != (0x2070, 1) and (index, sub) != (0x2071, 0):
            plain = pair.nodes[node].sdo.upload(index, sub)
            assert plain == upload(pair, node, index, sub)


def exchanges(master: Master, mark: int) -> list[tuple[bytes, ...]]:
    """TPDO 3 and 4 of node 1, then of node 2, for each SYNC since the mark that brought all."""
    wanted = (0x381, 0x481, 0x382, 0x482)
    rounds: list[dict[int, bytes]] = []
    for message in master.frames[mark:]:
        if message.arbitration_id == 0x080:
            rounds.append({})
        elif rounds and message.arbitration_id in wanted:
            rounds[-1][message.arbitration_id] = bytes(message.data)
    return [tuple(r[i] for i in wanted) for r in rounds if len(r) == 4]


def assert_period(master: Master, mark: int, box: Box) -> None:
    """The shorter of two times between SYNCs since the mark, to 50 us. A SYNC waits for the frame
    that is on the bus, so they are not all alike."""
    between = [gap * 1e6 for gap in gaps(master.since(mark, 0x080))]
    shorter = [min(two) for two in itertools.pairwise(between)]
    nearest = min(shorter, key=lambda gap: abs(gap - box.period_us))
    assert box.period_us == pytest.approx(nearest, abs=50), "its own clock"
    assert statistics.median(between) == pytest.approx(PERIOD_US, abs=50)


def test_the_box_holds_what_was_on_the_bus_around_the_event(plumb: Plumb, pair: Master) -> None:
    mark = pair.mark()
    wait_for_syncs(pair, 2 * BEFORE)
    break_b(plumb, pair)
    box = read_box(pair, 1, 1)
    assert (len(box.before), len(box.after)) == (BEFORE, AFTER)
    assert_period(pair, mark, box)
    kept = [(*f.own, *f.peer) for f in box.before + box.after]
    seen = exchanges(pair, mark)
    assert kept[0] in seen
    first = seen.index(kept[0])
    assert kept == seen[first : first + len(kept)]


def test_the_box_shows_the_fault_at_its_event(plumb: Plumb, pair: Master) -> None:
    break_b(plumb, pair)
    box = read_box(pair, 1, 1)
    assert all(f[2:] == (AGREE, NOBODY, 0) for f in box.before[:-2])
    assert box.before[-1][2:4] == (OTHER_FAULTY, PEER), "the SYNC that showed it"
    assert all(f[2:4] == (OTHER_FAULTY, PEER) for f in box.after)
    assert box.after[-1].reason == SET_UP_LOST
    assert all(q >= 32 for f in box.before + box.after for q in f.own[0][6:]), "A measured on"
    assert all(q in (STOPPED, SET_UP_LOST) for f in box.after for q in f.peer[0][6:])
    assert all(f.peer[1][:6] == b"\x00\x80" * 3 for f in box.after), "no acceleration"
    gravity = struct.unpack("<3h", box.after[-1].own[1][:6])
    assert sum((step / 2**13) ** 2 for step in gravity) == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize(
    "trouble",
    [
        "frozen",
        pytest.param("spi", marks=pytest.mark.virtual("the processor's own SPI fails")),
        "brown-out",
        "delay 200",
    ],
)
def test_the_box_of_the_faulty_channel_had_a_frame_twice_and_a_short_period(
    plumb: Plumb, pair: Master, trouble: str
) -> None:
    mark = pair.mark()
    wait_for_syncs(pair, 2 * BEFORE)
    break_b(plumb, pair, trouble)
    box = read_box(pair, 2, 1)
    assert_period(pair, mark, box)
    frames = box.before + box.after
    assert all(one.own != two.own for one, two in zip(frames, frames[1:]))


def test_the_box_and_the_log_name_each_other(plumb: Plumb, pair: Master) -> None:
    break_b(plumb, pair)
    for node in (1, 2):
        event = read_box(pair, node, 1).event
        assert event.box == 1
        assert event[:8] in [e[:8] for e in read_log(pair, node)]


def test_the_first_event_stays_and_the_latest_is_in_box_2(plumb: Plumb, pair: Master) -> None:
    break_b(plumb, pair)
    first = upload(pair, 1, 0x2071, 1)
    assert is_empty(pair, 1, 2)
    for trouble in ("offset 20", "noise 10"):
        plumb.type("heal b")
        plumb.truth()
        # A box is its reader's for three seconds more, since he may still be reading.
        wait_for_syncs(pair, 3_200_000 // PERIOD_US)
        pair.reset(2)
        pair.nmt(START)
        agreed(pair)
        break_b(plumb, pair, trouble)
        # A step is a disagreement first; B is blamed for it some 1.5 s later.
        until(lambda: read_log(pair, 1)[0].state == OTHER_FAULTY, f"B blamed for {trouble}", 10)
        wait_for_syncs(pair, AFTER + 4)
        assert upload(pair, 1, 0x2071, 1) == first
        latest = read_box(pair, 1, 2)
        assert latest.event.state == OTHER_FAULTY and latest.event.box == 2
        # An entry that tells the end of a fault has no box.
        newest = next(event for event in read_log(pair, 1) if event.code)
        assert latest.event[:8] == newest[:8]


def test_a_reset_and_a_loss_of_the_supply_leave_both(plumb: Plumb, pair: Master) -> None:
    break_b(plumb, pair)
    # Half a second for the box to be written, piece by piece beside the measuring.
    wait_for_syncs(pair, 1_000_000 // PERIOD_US)
    kept = [upload(pair, 1, 0x2070, 0), upload(pair, 1, 0x2071, 1)]
    pair.reset(1)
    assert [upload(pair, 1, 0x2070, 0), upload(pair, 1, 0x2071, 1)] == kept
    power_cycle(plumb, pair, "a", (1,))
    assert [upload(pair, 1, 0x2070, 0), upload(pair, 1, 0x2071, 1)] == kept


def test_both_are_emptied_when_asked_to_and_not_in_operational(
    plumb: Plumb, pair: Master
) -> None:
    break_b(plumb, pair)
    assert pair.refusal(1, 0x2072, 0, CLEAR.to_bytes(4, "little")) == WRONG_STATE
    pair.nmt(PRE_OPERATIONAL, 1)
    assert pair.refusal(1, 0x2072, 0, b"save") == CANNOT_STORE
    assert read_log(pair, 1) and not is_empty(pair, 1, 1)
    pair.write(1, 0x2072, 0, CLEAR)
    for again in (False, True):
        if again:
            power_cycle(plumb, pair, "a", (1,))
        assert upload(pair, 1, 0x2070, 0) == bytes([1, 20, 0, 0]) and is_empty(pair, 1, 1)
    assert read_log(pair, 2), "nobody has asked B"


def toggle_range(master: Master, node: int) -> None:
    """The measuring range is set off the level housing's slope, and back."""
    for low, code in ((20_000, RANGE_Y), (-90_000, 0)):
        mark = master.mark()
        master.write(node, 0x2040, 3, low)
        wanted = code.to_bytes(2, "little")
        master.next(0x80 + node, mark, data=lambda d: d[:2] == wanted)


def test_a_loose_contact_fills_two_entries_and_no_box(pair: Master) -> None:
    for _ in range(10):
        toggle_range(pair, 2)
    over, out = read_log(pair, 2)[:2]
    assert (over.code, over.faults, out.code, out.faults) == (0, 0, RANGE_Y, 2)
    entries = read_log(pair, 2)
    # A machine that is slow for a moment begins a new entry; none is lost.
    for code in (0, RANGE_Y):
        assert sum(1 + e.repeats for e in entries if e.code == code) == 10
    assert out.repeats and out.box == over.box == 0 and is_empty(pair, 2, 1)


def test_the_log_keeps_sixteen(plumb: Plumb, pair: Master) -> None:
    for number in range(10):
        toggle_range(pair, 1)
        # So far apart that none is a repetition.
        wait_for_syncs(pair, 55)
    log = read_log(pair, 1)
    assert len(log) == 16 and upload(pair, 1, 0x2070, 0)[3] == 20
    assert [e.code for e in log] == [0, RANGE_Y] * 8
    assert not any(e.repeats for e in log)


def test_the_same_event_after_a_reset_is_a_new_one(pair: Master) -> None:
    """Time begins anew at a reset, so an old entry may seem to be of this second."""
    # Heartbeats, 200 ms each, between two events: other steps in each life, so that some of the
    # new times come behind an old one.
    for beats in (6, 7):
        # Both, so that nobody makes SYNC and the state of the pair is the same in both lives.
        pair.reset()
        for _ in range(4):
            toggle_range(pair, 1)
            mark = pair.mark()
            until(lambda: len(pair.since(mark, 0x701)) >= beats, "heartbeats")
    log = read_log(pair, 1)
    assert len(log) == 16 and not any(e.repeats for e in log)


def test_what_happens_during_a_read_is_in_the_next_one(pair: Master) -> None:
    toggle_range(pair, 1)
    sdo = pair.nodes[1].sdo
    with sdo.open(0x2070, 0, "rb", buffering=0) as stream:
        data = stream.read(7)
        # By the range of node 2 nothing would happen to node 1; what does is a SYNC too long.
        mark = pair.mark()
        pair.nmt(0x80, 2)
        pair.next(0x081, mark, data=lambda d: d[:2] == OTHER_CODE.to_bytes(2, "little"))
        while piece := stream.read(7):
            data += piece
    assert len(data) == 4 + 20 * data[2] and data[2] == 2
    log = read_log(pair, 1)
    assert log[0].code == OTHER_CODE and log[1:] == [entry(data[4:24]), entry(data[24:44])]


def test_neither_can_be_written(pair: Master) -> None:
    for index, sub in ((0x2070, 0), (0x2071, 1), (0x2071, 2)):
        assert pair.refusal(1, index, sub, bytes(4)) == 0x0601_0002
