"""The chain on arrays gives the integers of the chip."""

from __future__ import annotations

import json
import math
import signal
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from conftest import ROOT, interrupted

import plumb

GOLDEN = json.loads((ROOT / "device" / "tests" / "golden.json").read_text())

# The vectors are read at every hundredth sample from this one on, 0.7 ms after it.
READ = range(199, 900, 100)
AFTER_US = 700


def golden(mode: str, pieces: int = 1) -> list[list[int]]:
    """Slope X, its uncertainty and slope Y by this package, the samples in so many pieces."""
    vectors = GOLDEN[mode]
    chain = plumb.Chain(bytes.fromhex(vectors["calibration"]), mode)
    samples = np.array(GOLDEN["samples"], dtype=np.int16)
    times = np.array(vectors["times_us"], dtype=np.uint64)
    found = []
    for numbers in np.array_split(np.arange(len(samples)), pieces):
        wanted = [number for number in READ if number in numbers]
        readings = chain.run(
            samples[numbers],
            times[numbers],
            temperature_degc=GOLDEN["temperature_q8"] / 256 if numbers[0] == 0 else None,
            read_us=times[wanted] + AFTER_US,
        )
        assert readings.valid.all()
        rows = zip(readings.angle[:, 0], readings.uncertainty[:, 0], readings.angle[:, 1])
        found += [[int(value) for value in row] for row in rows]
    return found


@pytest.mark.parametrize("mode", ["product", "paper"])
@pytest.mark.parametrize("pieces", [1, 7])
def test_the_integers_are_those_of_the_golden_vectors(mode: str, pieces: int) -> None:
    assert golden(mode, pieces) == GOLDEN[mode]["readings"]


def test_another_mode_gives_other_integers() -> None:
    vectors = GOLDEN["product"]
    chain = plumb.Chain(bytes.fromhex(vectors["calibration"]), "product", latency_us=0)
    times = np.array(vectors["times_us"], dtype=np.uint64)
    readings = chain.run(GOLDEN["samples"], times, temperature_degc=40.0)
    assert readings.angle[199, 0] != vectors["readings"][0][0]


def test_a_calibration_comes_back_as_it_was_given() -> None:
    given = bytes.fromhex(GOLDEN["product"]["calibration"])
    assert plumb.Chain(given).calibration == given


def test_reasons_and_instants_stand_beside_the_angles() -> None:
    chain = plumb.Chain()
    level = np.tile([0.0, 0.0, 1.0], (400, 1))
    readings = chain.run(accel_g=level)
    early = {plumb.REASONS[int(reason)] for reason in readings.reason[:100, 0]}
    assert early == {"the filter settles"}
    assert np.isnan(readings.angle_deg[0]).all() and readings.at_us[0].tolist() == [-1, -1]
    over_temperature = plumb.Chain(bytes.fromhex(GOLDEN["product"]["calibration"]))
    readings = over_temperature.run(accel_g=level)
    assert plumb.REASONS[int(readings.reason[-1, 0])] == "temperature not known"
    chain.reset()
    readings = chain.run(accel_g=level, temperature_degc=25.0)
    assert readings.valid[-1].all() and abs(readings.angle_deg[-1]).max() < 1e-3
    # Product mode declares 25 ms.
    assert readings.at_us[-1, 0] == readings.read_us[-1] - 25_000
    assert 0.0 < readings.uncertainty_deg[-1, 0] < 5.0


def test_a_tilt_in_g_is_the_angle_that_it_has() -> None:
    angle = math.radians(30.0)
    tilted = np.tile([math.sin(angle), 0.0, math.cos(angle)], (400, 1))
    readings = plumb.Chain().run(accel_g=tilted, temperature_degc=25.0)
    assert readings.angle_deg[-1] == pytest.approx([30.0, 0.0], abs=0.01)


def test_one_axis_goes_all_the_way_round() -> None:
    vectors = np.tile([0.5, 0.0, -math.sqrt(0.75)], (400, 1))
    fit = plumb.fit_motor(["x"] * 12, *turned(np.arange(0.0, 360.0, 30.0), "x"), mode="one-axis")
    readings = plumb.Chain(fit, "one-axis").run(accel_g=vectors, temperature_degc=25.0)
    assert readings.angle_deg[-1, 0] == pytest.approx(150.0, abs=0.05)
    assert plumb.REASONS[int(readings.reason[-1, 1])] == "this axis is not measured"


def turned(angles_deg: np.ndarray, axis: str) -> tuple[np.ndarray, np.ndarray]:
    """A motor's angles, and what an ideal part feels at them."""
    sin, cos = np.sin(np.radians(angles_deg)), np.cos(np.radians(angles_deg))
    zero = np.zeros_like(sin)
    columns = [sin, zero, cos] if axis == "x" else [zero, sin, cos]
    return angles_deg, np.column_stack(columns)


def sphere() -> np.ndarray:
    """Directions all around, of length 1 g."""
    axes = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
    directions = np.array([axis for axis in axes if any(axis)], dtype=float)
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_poses_find_scale_and_offset() -> None:
    scale, offset_g = np.array([1.02, 0.98, 1.01]), np.array([0.02, -0.01, 0.03])
    fit = plumb.fit_poses(sphere() * scale + offset_g)
    assert np.diag(fit.matrix) == pytest.approx(1.0 / scale, abs=1e-6)
    assert fit.offset_g == pytest.approx(-offset_g / scale, abs=1e-6)
    assert fit.residual_g < 1e-9 and fit.condition > 1.0
    felt = np.tile(np.array([0.5, 0.0, math.sqrt(0.75)]) * scale + offset_g, (400, 1))
    readings = plumb.Chain(fit).run(accel_g=felt, temperature_degc=25.0)
    assert readings.angle_deg[-1, 0] == pytest.approx(30.0, abs=0.02)


def test_a_motor_finds_a_crooked_part() -> None:
    # The part is turned by 2 deg about z in its housing.
    sin, cos = math.sin(math.radians(2.0)), math.cos(math.radians(2.0))
    crooked = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    angles = np.arange(-60.0, 61.0, 10.0)
    slope = ["x"] * len(angles) + ["y"] * len(angles)
    felt = np.vstack([turned(angles, axis)[1] for axis in "xy"]) @ crooked
    fit = plumb.fit_motor(slope, np.tile(angles, 2), felt)
    assert fit.matrix == pytest.approx(crooked, abs=1e-5) and fit.residual_g is None


@pytest.mark.parametrize(
    ("what", "words"),
    [
        (lambda: plumb.Chain(b"PLMC"), "these bytes are no calibration of a node: they end early"),
        (lambda: plumb.Chain(mode="fancy"), 'there is no mode "fancy": take product, dynamic'),
        (lambda: plumb.Chain().run(), "give either counts or accel_g"),
        (lambda: plumb.Chain().run([[1, 2]]), "counts is an array of n x 3"),
        (lambda: plumb.Chain().run([[1, 2, 40_000]]), "counts has values that int16 can't hold"),
        (lambda: plumb.Chain().run([[1, 2, math.nan]]), "counts has values that int16 can't hold"),
        (lambda: plumb.Chain().run([["a", "b", "c"]]), "counts is no array of numbers"),
        (lambda: plumb.Chain().run([[None] * 3]), "counts is no array of numbers"),
        (lambda: plumb.Chain().run([[1, 2, 3], [1, 2]]), "counts is no array of numbers"),
        (lambda: plumb.Chain().run([[1, 2, 3]], [1, 2]), "there are 1 samples and 2 of times_us"),
        # It was taken for an acceleration of 0, and gave a valid angle.
        (lambda: plumb.Chain().run(accel_g=[[0, 0, math.nan]]), "accel_g has values that are not"),
        (lambda: plumb.Chain().run(accel_g=[[0, 0, math.inf]]), "accel_g has values that are not"),
        (lambda: plumb.Chain().run(accel_g=[[0, 0]]), "accel_g is an array of n x 3"),
        (
            lambda: plumb.Chain().run(accel_g=[[0, 0, 1]], temperature_degc=math.nan),
            "temperature_degc has values that are no temperature",
        ),
        (
            lambda: plumb.Chain().run(accel_g=[[0, 0, 1]], temperature_degc=[math.inf]),
            "temperature_degc has values that are no temperature",
        ),
        (lambda: plumb.fit_poses(sphere()[:5]), "5 readings do not determine the fit; take at"),
        (lambda: plumb.fit_motor(["z"], [0.0], [[0, 0, 1]]), 'slope is "x" or "y" for each stand'),
        (lambda: plumb.fit_motor("x", [0.0], [[0, 0, 1]], "paper"), "paper mode has tables"),
    ],
)
def test_what_is_wrong_is_told_in_a_sentence(what, words: str) -> None:
    with pytest.raises(plumb.Error) as told:
        what()
    assert str(told.value).startswith(words), told.value


def test_a_calibration_file_that_is_none_is_told_by_its_name(tmp_path) -> None:
    path = tmp_path / "cal.json"
    path.write_text("{}")
    with pytest.raises(plumb.Error, match="cal.json"):
        plumb.Chain(path)
    with pytest.raises(plumb.Error, match="nowhere.json"):
        plumb.Chain(tmp_path / "nowhere.json")


def moving_g(samples: int, seconds_per_sample: float = 0.0025) -> np.ndarray:
    """What a level part feels that turns by 10 deg/s about one axis, from 0 deg on."""
    angles = np.radians(10.0 * seconds_per_sample * np.arange(samples))
    return np.column_stack([np.sin(angles), np.zeros(samples), np.cos(angles)])


def test_pieces_without_times_began_at_0_again_and_their_samples_were_dropped() -> None:
    moving = moving_g(1600)
    whole = plumb.Chain(mode="paper").run(accel_g=moving)
    chain = plumb.Chain(mode="paper")
    pieces = [chain.run(accel_g=piece) for piece in np.array_split(moving, 7)]
    for name in ("read_us", "angle", "uncertainty", "reason", "at_us"):
        joined = np.concatenate([getattr(piece, name) for piece in pieces])
        assert np.array_equal(joined, getattr(whole, name)), name
    assert chain.run(accel_g=moving[:1]).read_us.tolist() == [1600 * chain.period_us]
    chain.reset()
    assert chain.run(accel_g=moving[:2]).read_us.tolist() == [0, chain.period_us]


def test_samples_without_times_go_on_from_those_with_times() -> None:
    chain = plumb.Chain()
    chain.run(accel_g=moving_g(2), times_us=[70, 2570])
    assert chain.run(accel_g=moving_g(2)).read_us.tolist() == [5070, 7570]


def test_times_that_fall_were_taken_and_their_samples_dropped() -> None:
    moving = moving_g(4)
    falls = "give times in their order, or begin anew with reset\\(\\)$"
    chain = plumb.Chain()
    with pytest.raises(plumb.Error, match=r"^times_us\[2\] is 10 us and the one before it is"):
        chain.run(accel_g=moving, times_us=[0, 20, 10, 30])
    with pytest.raises(plumb.Error, match=falls):
        chain.run(accel_g=moving, times_us=[0, 10, 10, 20])
    with pytest.raises(plumb.Error, match=r"^read_us\[1\] is 5 us and the one before it is"):
        chain.run(accel_g=moving, read_us=[20, 5])
    # Nothing was taken in.
    assert chain.run(accel_g=moving).read_us[0] == 0
    earlier = "is 0 us and the newest sample of an earlier call is at 7500 us: " + falls
    with pytest.raises(plumb.Error, match=r"^times_us\[0\] " + earlier):
        chain.run(accel_g=moving, times_us=[0, 2500, 5000, 7500])
    with pytest.raises(plumb.Error, match=r"^read_us\[0\] " + earlier):
        chain.run(accel_g=moving, read_us=[0])
    chain.reset()
    chain.run(accel_g=moving, times_us=[0, 2500, 5000, 7500], read_us=[7500, 7500])
    latest = np.arange(2**64 - 4, 2**64, dtype=np.uint64)
    chain.run(accel_g=moving, times_us=latest)
    with pytest.raises(plumb.Error, match="the times of these samples are beyond 2\\^64 us"):
        chain.run(accel_g=moving)


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="there is no such signal")
def test_ctrl_c_waited_for_the_end_of_a_run() -> None:
    chain = plumb.Chain()
    counts = np.tile(np.array([0, 0, 16384], np.int16), (8_000_000, 1))
    with interrupted(0.2):
        chain.run(counts)
    # The chain is as it was after the samples that it has taken in.
    [after_us] = chain.run(counts[:1]).read_us
    assert 0 < after_us < len(counts) * chain.period_us and after_us % chain.period_us == 0


FULL_CIRCLE_DEG = np.arange(0.0, 360.0, 30.0)


@pytest.mark.parametrize(
    ("what", "words"),
    [
        (lambda: plumb.Chain(5), "calibration is of type int: give bytes of a node, the path of a"),
        (lambda: plumb.Chain(mode=None), "mode is None: give product, dynamic, paper or one-axis"),
        (lambda: plumb.Chain(latency_us=-1), "latency_us is -1: give a whole number from 0 to 429"),
        (lambda: plumb.Chain(latency_us=2**70), "latency_us is 1180591620717411303424: give a"),
        (lambda: plumb.Chain(latency_us=0.5), "latency_us is 0.5: give a whole number"),
        (lambda: plumb.Chain("none.json", channel=-1), "channel is -1: give a whole number from 0"),
        (lambda: plumb.Chain(channel=5), "channel is 5: only a file of calibrations has channels"),
        (
            lambda: plumb.Chain(plumb.fit_poses(sphere()), channel=5),
            "channel is 5: only a file of calibrations has channels",
        ),
        (
            lambda: plumb.Chain().run(accel_g=[[0, 0, 1]], temperature_degc="warm"),
            "temperature_degc is neither a number nor an array of numbers",
        ),
        (
            lambda: plumb.Chain().run(accel_g=[[0, 0, 1]], temperature_degc=1e6),
            "temperature_degc has 1e+06: a part tells -103 to 153 degC",
        ),
        (
            lambda: plumb.Chain().run(accel_g=[[0, 0, 1]] * 2, temperature_degc=[25.0, -300.0]),
            "temperature_degc has -300: a part tells -103 to 153 degC",
        ),
        (
            lambda: plumb.Chain().run(accel_g=[[0, 0, 1]], rates=[[0, 0, 0]]),
            "rates are of a gyroscope, which this mode does not have: leave them out",
        ),
        (
            lambda: plumb.Chain().run(np.ma.masked_greater([[0, 0, 16384]], 5)),
            "counts has masked values: leave these rows out",
        ),
        (
            lambda: plumb.Chain().run(accel_g=np.ma.masked_greater([[0, 0, 1.0]], 0.5)),
            "accel_g has masked values: leave these rows out",
        ),
        (
            lambda: plumb.fit_poses(np.vstack([sphere(), [[0, 0, math.nan]]])),
            "felt_g has values that are not finite: leave these stands out",
        ),
        (
            lambda: plumb.fit_poses(sphere() * 9.81),
            "felt_g is 9.81 long in the median, and gravity is 1: give it in g",
        ),
        (
            lambda: plumb.fit_motor(["x"], [0.0], [[0, 0, 1000]]),
            "felt_g is 1e+03 long in the median, and gravity is 1: give it in g",
        ),
        (
            lambda: plumb.fit_motor("x", [math.inf], [[0, 0, 1]]),
            "reference_deg has values that are not finite: leave these stands out",
        ),
        (
            lambda: plumb.fit_motor(
                ["x"] * 12 + ["y"] * 12,
                np.tile(FULL_CIRCLE_DEG, 2),
                np.vstack([turned(FULL_CIRCLE_DEG, axis)[1] for axis in "xy"]),
            ),
            "3 readings do not determine the fit; take at least 6 between -86 and 86 deg for each "
            "slope; 18 of 24 stands are outside and were left out",
        ),
    ],
)
def test_a_wrong_argument_was_told_from_inside_or_taken(what, words: str) -> None:
    with pytest.raises(plumb.Error) as told:
        what()
    assert str(told.value).startswith(words), told.value


def test_a_masked_temperature_was_not_read() -> None:
    level = np.tile([0.0, 0.0, 1.0], (400, 1))
    calibration = bytes.fromhex(GOLDEN["product"]["calibration"])
    masked = np.ma.masked_array(np.full(400, 25), mask=True)
    readings = plumb.Chain(calibration).run(accel_g=level, temperature_degc=masked)
    assert plumb.REASONS[int(readings.reason[-1, 0])] == "temperature not known"


def test_two_threads_on_one_chain_met_an_error_from_inside() -> None:
    chain = plumb.Chain()
    counts = np.tile(np.array([0, 0, 16384], np.int16), (100_000, 1))
    with ThreadPoolExecutor(4) as pool:
        runs = list(pool.map(lambda _: chain.run(counts).read_us, range(8)))
    firsts = sorted(int(read_us[0]) for read_us in runs)
    assert firsts == [number * len(counts) * chain.period_us for number in range(8)]


def test_comparing_fits_and_readings_was_an_error_of_numpy() -> None:
    one, same, other = (plumb.fit_poses(sphere() * scale) for scale in (1.01, 1.01, 1.02))
    assert one == same and one != other and one != "a fit"
    assert other in [one, other] and len({one, same, other}) == 2
    moving = moving_g(200)
    readings = plumb.Chain().run(accel_g=moving)
    assert readings == plumb.Chain().run(accel_g=moving) != plumb.Chain().run(accel_g=moving[1:])
    assert readings != plumb.Chain(mode="paper").run(accel_g=moving)
