"""The inclinometer profile: what a slope displays, and what is refused (CiA 410)."""

from __future__ import annotations

import time
from typing import Iterator

import pytest
from master import INVALID16, INVALID32, START, Master, Plumb, until

READ_ONLY, BAD_VALUE, TOO_HIGH, TOO_LOW = 0x0601_0002, 0x0609_0030, 0x0609_0031, 0x0609_0032
INVERTED, SCALED = 1, 2
ROLL, PITCH = -10.0, 30.0

# Units of 0.01 deg: the noise of two readings, five sigma, and the error of calibration.
NOISE, ERROR = 15, 25


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb("--speed", "4") as plumb:
        plumb.turn(PITCH, ROLL)
        yield plumb


def number(value: int, size: int) -> bytes:
    return value.to_bytes(size, "little", signed=True)


def near(value: float, tolerance: float = NOISE) -> object:
    return pytest.approx(value, abs=tolerance)


def test_the_device_type_is_that_of_an_inclinometer(master: Master) -> None:
    assert master.read(1, 0x1000) & 0xFFFF == 0x019A


@pytest.mark.parametrize(("slope", "degrees"), [(0x10, ROLL), (0x20, PITCH)])
@pytest.mark.parametrize("base", [0x6000, 0x6100])
def test_a_preset_in_all_four_operating_states(
    master: Master, slope: int, degrees: float, base: int
) -> None:
    at = base + slope
    for state in range(4):
        master.write(1, at + 1, 0, state)
        for preset in (0, 1234, -4500):
            master.write(1, at + 2, 0, preset)
            physical = -degrees * 100 if state & INVERTED else degrees * 100
            shown = master.read(1, at)
            expected = near(preset) if state & SCALED else near(physical, ERROR)
            assert shown == expected, f"state {state}, preset {preset}"
            assert master.read(1, at + 2) == preset
            assert master.read(1, at + 3) == near(preset - physical, ERROR)
            # What bit 1 hides is stored: it shows when the bit is set.
            master.write(1, at + 1, 0, state | SCALED)
            assert master.read(1, at) == near(preset)
            master.write(1, at + 1, 0, state)


def test_zeroing_works_as_delivered(master: Master) -> None:
    assert master.read(1, 0x6011) & SCALED, "bit 1 off is why zeroing `does not work` elsewhere"
    master.write(1, 0x6012, 0, 0)
    master.write(1, 0x6022, 0, 0)
    assert [master.read(1, 0x6010), master.read(1, 0x6020)] == [near(0), near(0)]
    assert master.read(2, 0x6020) == near(PITCH * 100, ERROR), "each node for itself"


def test_the_differential_offset_shifts_and_counts_in_the_preset(master: Master) -> None:
    before = master.read(1, 0x6020)
    master.write(1, 0x6024, 0, 500)
    assert master.read(1, 0x6020) == near(before + 500)
    # offset = preset - physical - differential offset: one that leaves it out reads 1700 here.
    master.write(1, 0x6022, 0, 1200)
    assert master.read(1, 0x6020) == near(1200)
    assert master.read(1, 0x6023) == near(1200 - PITCH * 100 - 500, ERROR)
    master.write(1, 0x6024, 0, 0)
    assert master.read(1, 0x6020) == near(700)


def test_16_and_32_bit_are_two_views_of_one_value(master: Master) -> None:
    for distance, value in ((1, 3), (4, -321), (2, 777)):
        master.write(1, 0x6110 + distance, 0, value)
        assert master.read(1, 0x6010 + distance) == value
    for distance, value in ((1, 2), (4, 123), (2, -88)):
        master.write(1, 0x6020 + distance, 0, value)
        assert master.read(1, 0x6120 + distance) == value
    for slope in (0x10, 0x20):
        assert master.read(1, 0x6003 + slope) == master.read(1, 0x6103 + slope)
        assert master.read(1, 0x6000 + slope) == near(master.read(1, 0x6100 + slope))


def test_the_resolution_is_the_unit_of_everything(master: Master) -> None:
    master.write(1, 0x6024, 0, 500)
    for unit, scale in ((100, 0.1), (1000, 0.01), (10, 1.0)):
        master.write(1, 0x6000, 0, unit)
        assert master.read(1, 0x6010) == near(ROLL * 100 * scale, ERROR * scale + 1)
        assert master.read(1, 0x6020) == near((PITCH * 100 + 500) * scale, ERROR * scale + 1)
        assert master.read(1, 0x6024) == 500 * scale


def test_a_resolution_that_16_bit_cannot_hold_is_refused(master: Master) -> None:
    for bad in (0, 1, 2, 5, 20, 999, 1001, 10_000, 65_535):
        refused = master.refusal(1, 0x6000, 0, bad.to_bytes(2, "little"))
        assert refused in (BAD_VALUE, TOO_HIGH, TOO_LOW), bad
        assert master.read(1, 0x6000) == 10
    assert master.refusal(1, 0x6000, 0, b"\x01\x00") == BAD_VALUE


def test_a_resolution_of_1_counts_once_the_range_fits(master: Master) -> None:
    for sub, bound in ((1, -32_000), (2, 32_000), (3, -32_000), (4, 32_000)):
        master.write(1, 0x2040, sub, bound)
    master.write(1, 0x6000, 0, 1)
    assert master.read(1, 0x6010) == near(ROLL * 1000, 10 * ERROR)
    refused = master.refusal(1, 0x2040, 2, number(90_000, 4))
    assert refused in (BAD_VALUE, TOO_HIGH, 0x0604_0043), "the range would leave 16 bit"
    assert master.read(1, 0x2040, 2) == 32_000
    assert master.refusal(1, 0x6014, 0, number(30_000, 2)) in (BAD_VALUE, TOO_HIGH)


def test_bits_of_the_operating_parameter_that_mean_nothing_are_refused(master: Master) -> None:
    for bad in (4, 8, 0x80, 0xFF):
        assert master.refusal(1, 0x6011, 0, bytes([bad])) in (BAD_VALUE, TOO_HIGH), bad
    assert master.read(1, 0x6011) == SCALED


def test_slopes_and_offsets_cannot_be_written(master: Master) -> None:
    for index, size in ((0x6010, 2), (0x6013, 2), (0x6110, 4), (0x6123, 4), (0x6511, 1)):
        assert master.refusal(1, index, 0, bytes(size)) == READ_ONLY, f"{index:X}"


def test_an_offset_that_16_bit_cannot_hold_is_refused_and_nothing_changes(master: Master) -> None:
    before = [master.read(1, 0x6110 + distance) for distance in (2, 3, 4)]
    assert master.refusal(1, 0x6112, 0, number(40_000, 4)) == TOO_HIGH
    assert master.refusal(1, 0x6112, 0, number(-40_000, 4)) == TOO_LOW
    assert master.refusal(1, 0x6114, 0, number(30_000, 4)) == TOO_HIGH
    assert master.refusal(1, 0x6014, 0, number(-30_000, 2)) == TOO_LOW
    assert [master.read(1, 0x6110 + distance) for distance in (2, 3, 4)] == before


def test_without_a_valid_angle_there_is_neither_slope_nor_preset(
    plumb: Plumb, master: Master
) -> None:
    plumb.type("fault a silent")
    try:
        until(lambda: master.read(1, 0x2020) & 3 == 0, "invalid angles")
        assert [master.read(1, i) for i in (0x6010, 0x6020)] == [INVALID16] * 2
        assert [master.read(1, i) for i in (0x6110, 0x6120)] == [INVALID32] * 2
        assert master.read(1, 0x2025, 1) != 0
        assert master.refusal(1, 0x6012, 0, bytes(2)) in (0x0800_0022, 0x0800_0024)
        assert master.read(1, 0x6013) == 0
    finally:
        plumb.type("heal a")


def test_the_temperature_is_in_degrees(plumb: Plumb, master: Master) -> None:
    # A thermometer may be off by some degrees (LIS2DW12, OUT_T), but not by how far it moves.
    warm = {node: master.read(node, 0x6511) for node in (1, 2)}
    assert all(degc == near(25, 15) for degc in warm.values()), warm
    try:
        start_at(plumb, master, {node: degc - 45 for node, degc in warm.items()}, -20)
    finally:
        start_at(plumb, master, warm, 25)


def start_at(plumb: Plumb, master: Master, shown: dict[int, int], degc: int) -> None:
    """The nodes are left there without power for long, then started; what each then shows."""
    master.settle()
    plumb.type("power all off", f"temp {degc} now")
    plumb.rest(0.1)
    mark = master.mark()
    plumb.type("power all on")
    for node, wanted in shown.items():
        master.next(0x700 + node, mark, data=lambda d: d == b"\0")
        until(lambda: master.read(node, 0x6511) == near(wanted, 3), f"{degc} degC", 5)


def test_a_temperature_that_jumps_is_none(plumb: Plumb, master: Master) -> None:
    """No die changes by 45 degC at once, so it is the thermometer that is faulty."""
    warm = {node: master.read(node, 0x6511) for node in (1, 2)}
    mark = master.mark()
    plumb.type("temp -20 now")
    try:
        for node in (1, 2):
            told = master.next(0x080 + node, mark, data=lambda d: d[:2] == b"\x07\xff")
            assert int.from_bytes(told.data[3:6], "little") & 1 << 20
            assert master.read(node, 0x6010) == INVALID16 and master.read(node, 0x2025, 1) == 12
    finally:
        start_at(plumb, master, warm, 25)


def test_the_second_logical_device_is_the_other_channel(plumb: Plumb, master: Master) -> None:
    assert master.read(1, 0x6810) == INVALID16, "nothing heard yet"
    master.nmt(START)
    for _ in range(10):
        master.sync()
        time.sleep(0.02)

    def is_the_other(node: int, distance: int) -> bool:
        master.sync()
        time.sleep(0.02)
        own = near(master.read(3 - node, 0x6000 + distance))
        return [master.read(node, base + distance) for base in (0x6800, 0x6900)] == [own, own]

    # An angle counts for half a second of the bus, an eighth of ours: a busy machine reads later.
    for node in (1, 2):
        for distance in (0x10, 0x20):
            until(lambda: is_the_other(node, distance), f"the other angle in node {node}")
    # It has parameters of its own. What was heard of it counts for 0.4 s.
    master.compare()
    master.write(1, 0x6812, 0, 0)
    assert master.read(1, 0x6810) == near(0)
    assert master.read(1, 0x6010) == near(ROLL * 100, ERROR)
    assert master.read(2, 0x6010) == near(ROLL * 100, ERROR)


def test_a_preset_stored_by_1010h_sub_3_outlasts_a_reset(master: Master) -> None:
    master.write(1, 0x6022, 0, 0)
    offset = master.read(1, 0x6023)
    assert master.refusal(1, 0x1010, 3, b"save") == 0
    try:
        master.reset(1)
        assert master.read(1, 0x6023) == offset
        assert master.read(1, 0x6020) == near(0)
    finally:
        assert master.refusal(1, 0x1011, 3, b"load") == 0
        master.reset(1)
    assert master.read(1, 0x6023) == 0


@pytest.fixture(scope="module")
def turntable() -> Iterator[Plumb]:
    """The instrument of one axis over 360 deg."""
    with Plumb("--mode", "one-axis", "--speed", "4") as plumb:
        plumb.turn(0, 30)
        yield plumb


@pytest.mark.virtual("the image has no one-axis mode")
def test_inverted_30_deg_reads_330_deg_over_the_full_circle(turntable: Plumb) -> None:
    with Master(turntable) as master:
        master.reset(1)
        assert master.read(1, 0x2030) == 1
        assert master.read(1, 0x6110) == near(3000, 100)
        # 36000 units of 0.01 deg don't fit into 16 bit, of neither logical device.
        assert master.refusal(1, 0x2040, 1, bytes(4)) == BAD_VALUE
        master.write(1, 0x6000, 0, 100)
        master.write(1, 0x6800, 0, 100)
        master.write(1, 0x2040, 1, 0)
        master.write(1, 0x2040, 2, 180_000)
        master.write(1, 0x6011, 0, INVERTED)
        assert [master.read(1, i) for i in (0x6010, 0x6110)] == [near(3300, 10)] * 2
        master.write(1, 0x6011, 0, 0)
        assert master.read(1, 0x6010) == near(300, 10)
