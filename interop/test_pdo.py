"""PDOs: what they carry, when they are sent, how they are changed (CiA 301, 7.2.2)."""

from __future__ import annotations

import statistics
import time
from typing import Iterator

import can
import pytest
from master import (
    INVALID16,
    MODE,
    PRE_OPERATIONAL,
    START,
    STOP,
    Master,
    Plumb,
    gaps,
    slopes,
    until,
)

OFF = 0x8000_0000
UNSUPPORTED, NO_OBJECT, NOT_MAPPABLE = 0x0601_0000, 0x0602_0000, 0x0604_0041
TOO_LONG, BAD_VALUE, NO_SUB = 0x0604_0042, 0x0609_0030, 0x0609_0011


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb("--speed", "4", "--slcan", "127.0.0.1:0") as plumb:
        plumb.turn(30, -10)
        yield plumb


def u(number: int, size: int) -> bytes:
    return number.to_bytes(size, "little")


def remap(master: Master, pdo: int, mapping: list[int], kind: int = 254, **timing: int) -> int:
    """Sets up a TPDO of node 1 by the standard's procedure; returns its identifier."""
    identifier = master.read(1, 0x1800 + pdo, 1) & 0x7FF
    master.write(1, 0x1800 + pdo, 1, OFF | identifier)
    master.write(1, 0x1800 + pdo, 2, kind)
    master.write(1, 0x1800 + pdo, 3, timing.get("inhibit", 0))
    master.write(1, 0x1800 + pdo, 5, timing.get("event", 0))
    master.write(1, 0x1A00 + pdo, 0, 0)
    for sub, entry in enumerate(mapping, 1):
        master.write(1, 0x1A00 + pdo, sub, entry)
    master.write(1, 0x1A00 + pdo, 0, len(mapping))
    master.write(1, 0x1800 + pdo, 1, identifier)
    return identifier


def syncs(master: Master, count: int) -> int:
    """Sends SYNC every 20 ms; returns the mark from before."""
    mark = master.mark()
    for _ in range(count):
        master.sync()
        time.sleep(0.02)
        # The answer comes behind the PDOs of this SYNC, however late this machine is.
        master.read(1, 0x1001)
    return mark


def activity(master: Master) -> int:
    """The activity that TPDO 4 of node 1 carries after one more SYNC."""
    syncs(master, 1)
    return master.nodes[1].tpdo[4][4].raw


def test_tpdo_1_as_delivered_carries_the_angles_that_sdo_reads(master: Master) -> None:
    master.nmt(START)
    master.compare()
    for node in (1, 2):
        unit = master.read(node, 0x6000)
        assert unit == 10
        read = {}
        for index in (0x2020, 0x2021, 0x6010, 0x6020):
            # An angle counts for half a second of the bus's time, which is an eighth of ours: each
            # is read right after a SYNC, however late this machine is with the one before.
            mark = syncs(master, 1)
            read[index] = master.read(node, index)
        data = master.next(0x180 + node, mark).data
        x, y = slopes(data)
        assert list(data[4:]) == [0x7F, 1] == [read[0x2020], read[0x2021]]
        # 0.2 deg: noise, and what is left after the calibration.
        assert abs(x * unit + 10_000) < 200 and abs(y * unit - 30_000) < 200
        assert abs(x - read[0x6010]) <= 10
        assert abs(y - read[0x6020]) <= 10


@pytest.mark.product("tables make no vector of the acceleration")
def test_python_canopen_decodes_every_default_tpdo(master: Master) -> None:
    node = master.nodes[1]
    node.tpdo.read()
    names = [[v.index for v in node.tpdo[n].map] for n in (1, 2, 3, 4)]
    assert names[0] == [0x6010, 0x6020, 0x2020, 0x2021]
    assert names[1] == [0x2020, 0x2021, 0x2022, 0x2023, 0x2024, 0x6511]
    assert names[2] == [0x2010] * 4 and names[3] == [0x2010] * 5
    master.nmt(START)
    master.compare()
    syncs(master, 10)
    assert abs(node.tpdo[1][0].raw + 1000) < 20
    assert node.tpdo[1][2].raw & 3 == 3 and node.tpdo[1][3].raw == 1
    assert node.tpdo[2][0].raw & 3 == 3
    assert node.tpdo[2][5].raw == pytest.approx(25, abs=6)
    assert node.tpdo[3][0].raw * 360 / 2**24 == pytest.approx(-10, abs=0.2)
    gravity = [node.tpdo[4][axis].raw / 2**13 for axis in range(3)]
    assert sum(g * g for g in gravity) == pytest.approx(1, abs=0.01)
    # One SYNC has up to 32 samples of noise, which scatter by 1.2 dB; each step is 0.4 dB. The
    # gyroscope's part has a low-pass of its own, which takes 3.5 dB of what is above 150 Hz.
    own = 55 if MODE == "dynamic" else 64
    activities = [activity(master) for _ in range(16)]
    assert statistics.mean(activities) == pytest.approx(own, abs=6), "the channel's own noise"


def test_tpdos_go_out_in_operational_only(master: Master) -> None:
    for command, expected in ((PRE_OPERATIONAL, 0), (START, 3), (STOP, 0), (START, 3)):
        master.nmt(command)
        mark = master.mark()
        for _ in range(3):
            last = master.mark()
            master.sync()
            if expected:
                master.next(0x482, last)
            else:
                time.sleep(0.02)
        pdos = [base + node for base in (0x180, 0x380, 0x480) for node in (1, 2)]
        found = [len(master.since(mark, i)) for i in pdos]
        assert found == [expected] * 6, f"NMT {command:#x}"


def test_two_syncs_back_to_back_are_two_samples(master: Master) -> None:
    master.nmt(START, 1)
    count, replaced = master.read(1, 0x2026, 1), master.read(1, 0x2052, 5)
    mark = master.mark()
    for _ in range(10):
        master.sync()
        master.sync()
        time.sleep(0.02)
    assert master.read(1, 0x2026, 1) == count + 20
    # SYNC outranks every PDO: what still waited when the second one came is replaced, and counted.
    identifiers = (0x181, 0x381, 0x481, *[0x401] * (MODE == "dynamic"))
    sent = sum(len(master.since(mark, i)) for i in identifiers)
    assert sent + master.read(1, 0x2052, 5) - replaced == 20 * len(identifiers)
    assert sent >= 10 * len(identifiers)


@pytest.mark.parametrize("n", [1, 3, 10])
def test_type_n_is_sent_at_every_nth_sync(master: Master, n: int) -> None:
    remap(master, 0, [0x6010_0010, 0x6020_0010], kind=n)
    master.nmt(START)
    mark = syncs(master, 12)
    assert len(master.since(mark, 0x181)) == 12 // n
    assert len(master.since(mark, 0x182)) == 12


@pytest.mark.sheets("objects of presets")
def test_type_0_is_sent_at_the_sync_after_a_change(master: Master) -> None:
    identifier = remap(master, 3, [0x6000_0010], kind=0)
    master.nmt(START, 1)
    first = len(master.since(syncs(master, 5), identifier))
    assert first <= 1, "not at every SYNC"
    mark = master.mark()
    master.write(1, 0x6000, 0, 100)
    master.rest(0.1)
    assert not master.since(mark, identifier), "not before a SYNC"
    mark = syncs(master, 5)
    assert [bytes(f.data) for f in master.since(mark, identifier)] == [u(100, 2)]


@pytest.mark.sheets("objects of presets")
@pytest.mark.parametrize("kind", [254, 255])
def test_types_254_and_255_are_sent_at_a_change(master: Master, kind: int) -> None:
    identifier = remap(master, 3, [0x6000_0010], kind=kind)
    master.nmt(START, 1)
    master.rest(0.1)
    mark = syncs(master, 3)
    assert not master.since(mark, identifier), "neither change nor event timer"
    master.write(1, 0x6000, 0, 100)
    assert master.next(identifier, mark).data == u(100, 2)
    master.rest(0.1)
    assert len(master.since(mark, identifier)) == 1


@pytest.mark.sheets("objects of presets")
def test_the_event_timer_sends_without_a_change(master: Master) -> None:
    identifier = remap(master, 3, [0x6000_0010], kind=255, event=50)
    mark = master.mark()
    master.nmt(START, 1)
    master.rest(0.6)
    found = gaps(master.since(mark, identifier))[1:]
    assert len(found) >= 8
    # 2 ms: a frame on the bus and the tick of the device.
    assert all(abs(gap - 0.05) < 0.002 for gap in found), found


def test_the_inhibit_time_keeps_a_busy_tpdo_apart(master: Master) -> None:
    identifier = remap(master, 3, [0x2031_0120], kind=254, inhibit=300)
    mark = master.mark()
    master.nmt(START, 1)
    master.rest(0.6)
    found = gaps(master.since(mark, identifier))
    assert len(found) >= 10, "the acceleration changes with every sample"
    assert min(found) > 0.0295, found
    assert max(found) < 0.05, found


def test_python_canopen_remaps_by_the_standard_procedure(master: Master) -> None:
    node = master.nodes[1]
    node.tpdo.read()
    tpdo = node.tpdo[4]
    tpdo.clear()
    tpdo.add_variable(0x6120)
    tpdo.add_variable(0x6511)
    tpdo.cob_id, tpdo.trans_type, tpdo.enabled = 0x4E1, 1, True
    tpdo.save()
    master.nmt(START)
    master.compare()
    mark = syncs(master, 2)
    data = master.next(0x4E1, mark).data
    assert len(data) == 5
    assert int.from_bytes(data[:4], "little", signed=True) == pytest.approx(3000, abs=20)


UNMAPPABLE = {
    0x6011_0008: NOT_MAPPABLE,
    0x2011_0118: NOT_MAPPABLE,
    0x1018_0420: NOT_MAPPABLE,
    0x6010_0008: NOT_MAPPABLE,
    0x6010_0020: NOT_MAPPABLE,
    0x5FFF_0010: NO_OBJECT,
    0x6010_0110: NO_SUB,
}


@pytest.mark.sheets("objects of presets")
def test_a_non_mappable_object_is_refused_and_named(master: Master) -> None:
    master.write(1, 0x1800, 1, OFF | 0x181)
    master.write(1, 0x1A00, 0, 0)
    for entry, code in UNMAPPABLE.items():
        assert master.refusal(1, 0x1A00, 1, u(entry, 4)) == code, f"{entry:08X}"
        assert master.read(1, 0x1A00, 1) == 0x6010_0010, "a refused write changes nothing"


def test_a_mapping_with_a_gap_is_refused(master: Master) -> None:
    master.write(1, 0x1800, 1, OFF | 0x181)
    master.write(1, 0x1A00, 0, 0)
    refused = master.refusal(1, 0x1A00, 1, bytes(4)) or master.refusal(1, 0x1A00, 0, b"\x01")
    assert refused in (NO_OBJECT, NOT_MAPPABLE)


def test_a_mapping_count_of_200_is_refused(master: Master) -> None:
    master.write(1, 0x1800, 1, OFF | 0x181)
    master.write(1, 0x1A00, 0, 0)
    for count in (9, 64, 200, 255):
        assert master.refusal(1, 0x1A00, 0, bytes([count])) == TOO_LONG
        assert master.read(1, 0x1A00, 0) == 0


def test_more_than_eight_bytes_are_refused(master: Master) -> None:
    master.write(1, 0x1800, 1, OFF | 0x181)
    master.write(1, 0x1A00, 0, 0)
    for sub, entry in enumerate([0x6110_0020, 0x6120_0020, 0x6511_0008], 1):
        master.write(1, 0x1A00, sub, entry)
    assert master.refusal(1, 0x1A00, 0, b"\x03") == TOO_LONG
    assert master.refusal(1, 0x1A00, 0, b"\x02") == 0


def test_a_pdo_that_is_on_keeps_its_mapping_and_identifier(master: Master) -> None:
    before = [master.read(1, 0x1A00, sub) for sub in range(3)]
    assert master.refusal(1, 0x1A00, 0, b"\x00") == UNSUPPORTED
    assert master.refusal(1, 0x1A00, 1, u(0x6020_0010, 4)) == UNSUPPORTED
    assert master.refusal(1, 0x1800, 1, u(0x1A1, 4)) != 0
    assert master.refusal(1, 0x1800, 3, u(100, 2)) == UNSUPPORTED
    assert [master.read(1, 0x1A00, sub) for sub in range(3)] == before
    assert master.read(1, 0x1800, 1) & 0x7FF == 0x181


def test_identifiers_that_belong_to_other_services_are_refused(master: Master) -> None:
    master.write(1, 0x1800, 1, OFF | 0x181)
    for bad in (0x000, 0x001, 0x07F, 0x101, 0x180, 0x581, 0x601, 0x6E0, 0x701, 0x7FF):
        assert master.refusal(1, 0x1800, 1, u(bad, 4)) == BAD_VALUE, f"{bad:X}"


def test_identifiers_of_29_bit_are_refused(master: Master) -> None:
    master.write(1, 0x1800, 1, OFF | 0x181)
    assert master.refusal(1, 0x1800, 1, u(0x2001_2345, 4)) == BAD_VALUE


def test_transmission_types_that_do_not_exist_are_refused(master: Master) -> None:
    for kind in (241, 251, 252, 253):
        assert master.refusal(1, 0x1800, 2, bytes([kind])) == BAD_VALUE
    assert master.read(1, 0x1800, 2) == 1


def exchange(x: int, y: int) -> bytes:
    """RPDO 1 as delivered: two angles of 24 bit and their qualities."""
    return (x & 0xFFFFFF).to_bytes(3, "little") + (y & 0xFFFFFF).to_bytes(3, "little") + b"\x60\x60"


def received(master: Master) -> list[int]:
    return [master.read(1, 0x2011, sub) for sub in (1, 2, 3, 4)]


def test_an_rpdo_goes_where_it_is_mapped(master: Master) -> None:
    master.nmt(START, 1)
    master.send(0x382, exchange(-466033, 1398101))
    assert received(master) == [-466033, 1398101, 0x60, 0x60]


def test_an_rpdo_that_came_in_pre_operational_is_not_applied_at_start(master: Master) -> None:
    before = received(master)
    master.send(0x382, exchange(1234, 5678))
    assert received(master) == before
    master.nmt(START, 1)
    assert received(master) == before


def test_a_synchronous_rpdo_waits_for_sync(master: Master) -> None:
    master.write(1, 0x1400, 2, 1)
    master.nmt(START, 1)
    before = received(master)
    master.send(0x382, exchange(77, 88))
    assert received(master) == before
    master.sync()
    assert received(master) == [77, 88, 0x60, 0x60]


@pytest.mark.parametrize("length", [7, 0])
def test_a_short_rpdo_is_refused_and_reported(master: Master, length: int) -> None:
    master.nmt(START, 1)
    master.send(0x382, exchange(77, 88))
    mark = master.mark()
    master.send(0x382, exchange(1, 2)[:length])
    emcy = master.next(0x081, mark)
    assert int.from_bytes(emcy.data[:2], "little") == 0x8210
    assert received(master) == [77, 88, 0x60, 0x60]


def test_a_long_rpdo_is_used_and_reported(master: Master) -> None:
    master.write(1, 0x1400, 1, OFF | 0x382)
    master.write(1, 0x1600, 0, 0)
    master.write(1, 0x1600, 0, 2)
    master.write(1, 0x1400, 1, 0x382)
    master.nmt(START, 1)
    mark = master.mark()
    master.send(0x382, exchange(77, 88))
    assert int.from_bytes(master.next(0x081, mark).data[:2], "little") == 0x8220
    assert received(master)[:2] == [77, 88]


def test_an_rpdo_that_stays_away_is_reported(master: Master) -> None:
    master.write(1, 0x1400, 5, 100)
    master.nmt(START, 1)
    mark = master.mark()
    master.rest(0.3)
    assert not master.since(mark, 0x081), "supervision begins with the first one"
    master.send(0x382, exchange(77, 88))
    emcy = master.next(0x081, mark)
    assert int.from_bytes(emcy.data[:2], "little") == 0x8250


@pytest.fixture
def adapter(plumb: Plumb) -> Iterator[can.BusABC]:
    """An SLCAN client: socketcand has no remote frames."""
    place = plumb.ready.rsplit("SLCAN ", 1)[1]
    bus = can.Bus(interface="slcan", channel=f"socket://{place}", sleep_after_open=0)
    yield bus
    bus.shutdown()


def test_a_remote_frame_is_answered_unless_bit_30_is_set(
    master: Master, adapter: can.BusABC
) -> None:
    master.nmt(START)
    request = can.Message(
        arbitration_id=0x181, is_remote_frame=True, dlc=6, is_extended_id=False
    )
    # Two clients have no order among each other: the answer shows that START has come.
    master.read(1, 0x1001)
    mark = master.mark()
    adapter.send(request)
    until(lambda: [f for f in master.since(mark, 0x181) if not f.is_remote_frame], "the answer")
    master.write(1, 0x1800, 1, OFF | 0x181)
    master.write(1, 0x1800, 1, 0x4000_0181)
    mark = master.mark()
    adapter.send(request)
    master.rest(0.2)
    assert not [f for f in master.since(mark, 0x181) if not f.is_remote_frame]


def test_before_the_first_valid_angle_a_slope_is_never_a_plausible_number(master: Master) -> None:
    mark = master.mark()
    master.nmt(0x81)
    master.next(0x701, mark, data=lambda d: d == b"\0")
    master.nmt(START)
    mark = syncs(master, 60)
    frames = [bytes(f.data) for f in master.since(mark, 0x181)]
    assert slopes(frames[0]) == [INVALID16, INVALID16]
    for data in frames:
        x, y = slopes(data)
        assert [x != INVALID16, y != INVALID16] == [data[4] & 1 != 0, data[4] & 2 != 0]
        assert x == INVALID16 or abs(x + 1000) < 25
        assert y == INVALID16 or abs(y - 3000) < 25
    assert INVALID16 not in slopes(frames[-1])
