"""What logs came to: summaries as bytes, which merge exactly, and the report of a period."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Iterable
from pathlib import Path

from . import _plumb
from ._plumb import Error, IncompleteWarning
from .logs import Path as Log
from .logs import logs_of, node_ids, path_of, paths


def summarise(
    log: Log | Iterable[Log],
    eds: Log | Iterable[Log] | None = None,
    *,
    nodes: Iterable[int] = (),
) -> bytes:
    """Counts logs as `plumb report` does; a summary whose size does not grow with them.

    Of all pairs of nodes 1 and 2, 3 and 4 and so on, or of `nodes` A, B, A, B. What could not be
    read is told by an `IncompleteWarning`.
    """
    sheets = [] if eds is None else paths(eds)
    summary, incomplete = _plumb.summarise(logs_of(log), sheets, node_ids(nodes))
    if incomplete is not None:
        warnings.warn(incomplete, IncompleteWarning, stacklevel=2)
    return summary


def merge(summaries: Iterable[bytes]) -> bytes:
    """The summary of all these, the same bytes in any order and in any groups."""
    if isinstance(summaries, (bytes, bytearray)):
        raise Error("merge takes a list of summaries, and not one alone")
    if not isinstance(summaries, Iterable):
        raise Error(f"{summaries!r} is no list of summaries: give what summarise has returned")
    return _plumb.merge([_summary(one) for one in summaries])


def _summary(given: object) -> bytes:
    """The bytes of a summary.

    Errors: `Error` where it is something else.
    """
    try:
        return bytes(memoryview(given))  # type: ignore[arg-type]
    except TypeError:
        kind = type(given).__name__
        raise Error(f"a summary is of type {kind}: give the bytes of summarise or merge") from None


def report(
    summary: bytes, path: str | os.PathLike[str], *, bit_rate: float | None = None
) -> Path:
    """Writes report.html and report.json of `plumb report` into a folder; the path of the page.

    `bit_rate` in bit/s, to state the load of the bus in per cent.
    """
    try:
        rate = None if bit_rate is None else float(bit_rate)
        is_rate = not isinstance(bit_rate, str) and (rate is None or 0 < rate < math.inf)
    except (TypeError, ValueError, OverflowError):
        is_rate = False
    if not is_rate:
        raise Error(f"{bit_rate} bit/s is no bit rate: give more than 0")
    html, _ = _plumb.report(_summary(summary), path_of(path, "path"), rate)
    return Path(html)
