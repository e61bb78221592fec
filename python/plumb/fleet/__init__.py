"""A fleet of machines: their logs to summaries, tables and a page, on one machine or on many.

`run` counts a tree or bucket of logs into a folder, on the processes of this machine or on a Dask
cluster, and does not do again what is finished. `query` asks the figures in the folder by SQL, and
`visits` lists the machines that need a visit. `python -m plumb.fleet LOGS OUT` does the same from
a shell; docs/fleet.md describes it. It needs `pip install plumb[fleet]`.

Left out: a scheduler of its own, and where logs come from.
"""

from __future__ import annotations

from .asking import QUESTIONS, query
from .errors import FleetError
from .runs import Outcome, run
from .visits import Reason, Rules, Visit, visits

__all__ = [
    "QUESTIONS",
    "FleetError",
    "Outcome",
    "Reason",
    "Rules",
    "Visit",
    "query",
    "run",
    "visits",
]
