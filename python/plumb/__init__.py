"""Plumb, a redundant inclinometer: logs, the signal chain and the virtual instrument.

`decode` reads logs of a bus, `summarise` counts them, `Chain` runs the instrument's signal chain on
arrays, `Twin` is the virtual instrument in virtual time, and `plumb.bus` puts it under python-can.
Whatever can't be done raises `Error` with the sentence that the program `plumb` would print.
docs/python.md is a tour.
"""

from __future__ import annotations

from ._plumb import Error, IncompleteWarning
from .chain import REASONS, Chain, Fit, Readings, fit_motor, fit_poses
from .logs import Decoded, Skipped, decode
from .summaries import merge, report, summarise
from .twin import Frame, Truth, Twin

__all__ = [
    "REASONS",
    "Chain",
    "Decoded",
    "Error",
    "Fit",
    "Frame",
    "IncompleteWarning",
    "Readings",
    "Skipped",
    "Truth",
    "Twin",
    "decode",
    "fit_motor",
    "fit_poses",
    "merge",
    "report",
    "summarise",
]
