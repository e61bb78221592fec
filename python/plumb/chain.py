"""The instrument's signal chain on arrays, and the fits of a calibration."""

from __future__ import annotations

import operator
import os
from dataclasses import dataclass, fields
from typing import Union

import numpy as np
import numpy.typing as npt

from . import _plumb
from ._plumb import Error
from .single import Single

Calibration = Union[bytes, str, "os.PathLike[str]", "Fit"]

DEG_PER_STEP = 360.0 / 2**32

COLDEST_DEGC, HOTTEST_DEGC = -103.0, 153.0
"""What a part can tell: 16 bits, 256 steps per degC, 0 at 25 degC (both data sheets)."""

REASONS: dict[int, str] = _plumb.reasons()
"""Why there is no angle, in words, by the code in `Readings.reason`; 0 stands for an angle."""


class _Arrays:
    """A dataclass with arrays, which are equal where all their values are."""

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        names = [field.name for field in fields(self)]  # type: ignore[arg-type]
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in names)


@dataclass(frozen=True, eq=False)
class Readings(_Arrays):
    """What a chain has read: a row for each instant, a column for axis X and one for axis Y."""

    read_us: npt.NDArray[np.uint64]
    """The instants that were asked for, us."""
    angle: npt.NDArray[np.int32]
    """Angles as the chip has them, 2^-32 of a circle; 0 without one."""
    uncertainty: npt.NDArray[np.uint32]
    """Standard uncertainties (k = 1), 2^-32 of a circle; 2^32 - 1 for none."""
    reason: npt.NDArray[np.uint8]
    """0 for an angle, or why there is none (`REASONS`)."""
    at_us: npt.NDArray[np.int64]
    """The instants that the angles belong to, us; -1 without an angle."""

    @property
    def valid(self) -> npt.NDArray[np.bool_]:
        """Where there is an angle."""
        return self.reason == 0

    @property
    def angle_deg(self) -> npt.NDArray[np.float64]:
        """Angles in degrees; NaN without one."""
        return np.where(self.valid, self.angle * DEG_PER_STEP, np.nan)

    @property
    def uncertainty_deg(self) -> npt.NDArray[np.float64]:
        """Standard uncertainties in degrees; NaN where they are not known."""
        known = self.valid & (self.uncertainty != 2**32 - 1)
        return np.where(known, self.uncertainty * DEG_PER_STEP, np.nan)


@dataclass(frozen=True, eq=False)
class Fit(_Arrays):
    """A fitted correction; a `Chain` takes it as its calibration."""

    calibration: bytes
    """As a node stores it, with the data sheet's uncertainty budget."""
    matrix: npt.NDArray[np.float64]
    """Housing axis by part axis, g per g."""
    offset_g: npt.NDArray[np.float64]
    """Added after the matrix, g."""
    residual_g: float | None
    """Root mean square of length minus 1 g over the poses; None of a motor."""
    condition: float
    """Condition figure of the fit."""

    def __hash__(self) -> int:
        return hash(self.calibration)


class Chain(Single):
    """One channel's signal chain, with its memory: samples may come in pieces.

    `calibration` is what a node stores (bytes), a file of `plumb replay --save-calibration`, a
    `Fit`, or None for a part as its data sheet has it; `channel` counts the channels of a file from
    0. `mode` is product, dynamic, paper or one-axis. `latency_us` replaces the mode's: 0 reads the
    newest sample, whatever its age. Calls from several threads are made one after the other.

    Errors: `Error` where an argument is wrong.
    """

    def __init__(
        self,
        calibration: Calibration | None = None,
        mode: str = "product",
        *,
        channel: int = 0,
        latency_us: int | None = None,
    ) -> None:
        given = calibration.calibration if isinstance(calibration, Fit) else calibration
        if not (given is None or isinstance(given, (bytes, bytearray, str, os.PathLike))):
            kind = type(calibration).__name__
            raise Error(
                f"calibration is of type {kind}: "
                "give bytes of a node, the path of a file, a Fit or None"
            )
        if not isinstance(mode, str):
            raise Error(f"mode is {mode!r}: give product, dynamic, paper or one-axis")
        channel = _count(channel, "channel", 2**32)
        if channel and (given is None or isinstance(given, (bytes, bytearray))):
            raise Error(f"channel is {channel}: only a file of calibrations has channels")
        if latency_us is not None:
            latency_us = _count(latency_us, "latency_us", 2**32)
        self._chain = _plumb.Chain(given, mode, channel, latency_us)

    @property
    def period_us(self) -> int:
        """Nominal time between samples, us."""
        return self._chain.period_us

    @property
    def counts_per_g(self) -> int:
        """Left-justified counts of one g."""
        return self._chain.counts_per_g

    @property
    def deg_s_per_count(self) -> float | None:
        """Deg/s of one count of the gyroscope; None in a mode without one."""
        return self._chain.deg_s_per_count

    @property
    def calibration(self) -> bytes:
        """The calibration as a node stores it."""
        return self._chain.calibration

    def reset(self) -> None:
        """Forgets all samples."""
        self._chain.reset()

    def counts(self, accel_g: npt.ArrayLike) -> npt.NDArray[np.int16]:
        """Accelerations in g as counts, clipped at the ends of the range.

        Errors: `Error` where one is not finite: a sample that is missing has no value.
        """
        counts = np.round(_reals(accel_g, "accel_g", "samples") * self.counts_per_g)
        return np.clip(counts, -(2**15), 2**15 - 1).astype(np.int16)

    def run(
        self,
        counts: npt.ArrayLike | None = None,
        times_us: npt.ArrayLike | None = None,
        *,
        accel_g: npt.ArrayLike | None = None,
        temperature_degc: npt.ArrayLike | float | None = None,
        rates: npt.ArrayLike | None = None,
        read_us: npt.ArrayLike | None = None,
    ) -> Readings:
        """Takes samples in and reads at `read_us`, or else at the time of each sample.

        `counts` is n x 3 of int16, left-justified as the part gives them, or `accel_g` n x 3 in g.
        `times_us` are the times of capture, which rise, also from call to call. Without them each
        sample comes one nominal period after the one before it, the first of all at 0.
        `temperature_degc` is one value, taken in before the first sample, or n of them with NaN
        where none was read or the array is masked; a calibration over temperature gives no angle
        before the first of them.
        `rates` is n x 3 of int16, counts of a gyroscope. `read_us` does not fall, and begins at the
        newest sample of an earlier call or later.

        Errors: `Error` where an array has another shape, or times fall; nothing was taken in then.
        """
        if counts is not None and accel_g is None:
            samples = _triples(counts, np.int16, "counts")
        elif accel_g is not None and counts is None:
            samples = _triples(self.counts(accel_g), np.int16, "accel_g")
        else:
            raise Error("give either counts or accel_g")
        if rates is not None and self.deg_s_per_count is None:
            raise Error("rates are of a gyroscope, which this mode does not have: leave them out")
        found = self._chain.run(
            samples,
            None if times_us is None else _flat(times_us, np.uint64, "times_us"),
            _temperatures(temperature_degc, len(samples)),
            None if rates is None else _triples(rates, np.int16, "rates"),
            None if read_us is None else _flat(read_us, np.uint64, "read_us"),
        )
        return Readings(*found)


def _count(given: int, name: str, end: int) -> int:
    """A whole number below `end`.

    Errors: `Error` where it is none.
    """
    try:
        number = operator.index(given)
    except TypeError:
        raise Error(f"{name} is {given!r}: give a whole number") from None
    if not 0 <= number < end:
        raise Error(f"{name} is {number}: give a whole number from 0 to {end - 1}")
    return number


def fit_poses(felt_g: npt.ArrayLike) -> Fit:
    """Fits matrix and offset to the mean acceleration of nine poses or more, n x 3 in g."""
    return _fit(_plumb.fit_poses(_felt(felt_g)))


def fit_motor(
    slope: npt.ArrayLike,
    reference_deg: npt.ArrayLike,
    felt_g: npt.ArrayLike,
    mode: str = "product",
) -> Fit:
    """Fits matrix, offset and harmonics to a motor's stands.

    `slope` is "x" or "y" for each stand: what was turned; `reference_deg` the motor's angle;
    `felt_g` the mean acceleration, n x 3 in g. In mode one-axis all is turned about one axis; in
    the others stands beyond 86 deg serve for the matrix, and not for the harmonics.
    """
    axes = np.asarray(slope)
    if not np.isin(axes, ["x", "y"]).all():
        raise Error('slope is "x" or "y" for each stand')
    turned = np.ascontiguousarray(axes == "y", dtype=np.uint8).reshape(-1)
    references = _reals(reference_deg, "reference_deg", "stands")
    angles = _flat(references, np.float64, "reference_deg")
    return _fit(_plumb.fit_motor(mode, turned, angles, _felt(felt_g)))


def _felt(felt_g: npt.ArrayLike) -> npt.NDArray:
    felt = _triples(_reals(felt_g, "felt_g", "stands"), np.float64, "felt_g")
    # A part is off by some per cent; m/s2 and mg are by a factor of ten and of a thousand.
    length = np.median(np.linalg.norm(felt, axis=1)) if len(felt) else 1.0
    if not 0.5 <= length <= 2.0:
        raise Error(f"felt_g is {length:.3g} long in the median, and gravity is 1: give it in g")
    return felt


def _fit(fitted: _plumb.Fitted) -> Fit:
    return Fit(
        calibration=bytes(fitted.calibration),
        matrix=np.array(fitted.matrix),
        offset_g=np.array(fitted.offset_g),
        residual_g=fitted.residual_g,
        condition=fitted.condition,
    )


def _triples(values: npt.ArrayLike, dtype: type, name: str) -> npt.NDArray:
    array = _exact(values, dtype, name)
    if array.ndim != 2 or array.shape[1] != 3:
        raise Error(f"{name} is an array of n x 3, and not of {array.shape}")
    return array


def _flat(values: npt.ArrayLike, dtype: type, name: str) -> npt.NDArray:
    array = _exact(values, dtype, name)
    if array.ndim != 1:
        raise Error(f"{name} is an array of n, and not of {array.shape}")
    return array


def _exact(values: npt.ArrayLike, dtype: type, name: str) -> npt.NDArray:
    """Without a copy where the array is of this type already; no value may change."""
    _refuse_mask(values, name)
    try:
        given = np.asarray(values)
        with np.errstate(invalid="ignore"):
            array: npt.NDArray = np.ascontiguousarray(given, dtype=dtype)
    except OverflowError:
        raise Error(f"{name} has values that {np.dtype(dtype).name} can't hold") from None
    except (TypeError, ValueError):
        raise Error(f"{name} is no array of numbers") from None
    if given.dtype != dtype and not np.array_equal(given, array):
        raise Error(f"{name} has values that {np.dtype(dtype).name} can't hold")
    return array


def _reals(values: npt.ArrayLike, name: str, rows: str) -> npt.NDArray[np.float64]:
    """Finite numbers; what has a row with another value is to leave such rows out."""
    _refuse_mask(values, name)
    try:
        if np.iscomplexobj(values):
            raise TypeError
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise Error(f"{name} is no array of numbers") from None
    if not np.isfinite(array).all():
        raise Error(f"{name} has values that are not finite: leave these {rows} out")
    return array


def _refuse_mask(values: object, name: str) -> None:
    """Refuses an array of which values are masked: numpy has numbers behind the mask."""
    if np.ma.is_masked(values):
        raise Error(f"{name} has masked values: leave these rows out")


def _temperatures(given: npt.ArrayLike | float | None, samples: int) -> npt.NDArray | None:
    if given is None:
        return None
    try:
        if isinstance(given, np.ma.MaskedArray):
            given = np.ma.filled(given.astype(np.float64), np.nan)
        array = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise Error("temperature_degc is neither a number nor an array of numbers") from None
    # NaN in an array is a temperature that was not read; one value is one that was.
    if np.isinf(array).any() or (array.ndim == 0 and np.isnan(array)):
        raise Error("temperature_degc has values that are no temperature")
    read = array[~np.isnan(array)]
    beyond = read[(read < COLDEST_DEGC) | (read > HOTTEST_DEGC)]
    if beyond.size:
        raise Error(
            f"temperature_degc has {beyond.flat[0]:g}: "
            f"a part tells {COLDEST_DEGC:g} to {HOTTEST_DEGC:g} degC"
        )
    if array.ndim == 0:
        once = np.full(samples, np.nan)
        once[:1] = array
        return once
    if array.ndim != 1:
        raise Error(f"temperature_degc is an array of n, and not of {array.shape}")
    return np.ascontiguousarray(array)
