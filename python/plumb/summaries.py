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
from .logs import logs_of, node_ids, paths


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
    return _plumb.merge(list(summaries))


def report(
    summary: bytes, path: str | os.PathLike[str], *, bit_rate: float | None = None
) -> Path:
    """Writes report.html and report.json of `plumb report` into a folder; the path of the page.

    `bit_rate` in bit/s, to state the load of the bus in per cent.
    """
    if bit_rate is not None and not 0 < bit_rate < math.inf:
        raise Error(f"{bit_rate} bit/s is no bit rate: give more than 0")
    html, _ = _plumb.report(bytes(summary), os.fspath(path), bit_rate)
    return Path(html)
