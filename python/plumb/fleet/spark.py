"""The same map and merge as a Spark job: `plumb.fleet.spark.run(session, LOGS, OUT)`.

In: a session, and what `plumb.fleet.run` takes. Out: the same folder with the same bytes. Logs and
days go out as an RDD, some groups for each processor of the cluster at a time, so that this
process's memory does not grow with their number; Spark does a lost executor's groups again. The
package has to be installed where the executors run.

Left out: reading and writing tables by Spark; the results are in files of Parquet anyway.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from typing import Any

from .errors import FleetError, first_line
from .runs import Outcome
from .runs import run as run_on
from .schedulers import AHEAD, Function, groups


class Spark:
    """The executors of a Spark session."""

    def __init__(self, session: Any) -> None:
        self._context = session.sparkContext

    def map(
        self, function: Function, jobs: Iterable[tuple[Any, int]], *more: Any
    ) -> Iterator[tuple[list[Any], list]]:
        """Each group with what came of it.

        Errors: `FleetError` where Spark can't do a group.
        """
        wave: list[list[Any]] = []
        most = AHEAD * max(1, self._context.defaultParallelism)
        for group in groups(jobs):
            wave.append(group)
            if len(wave) == most:
                yield from self._done(function, wave, more)
                wave = []
        if wave:
            yield from self._done(function, wave, more)

    def _done(
        self, function: Function, wave: list[list[Any]], more: tuple[Any, ...]
    ) -> Iterator[tuple[list[Any], list]]:
        def call(group: list[Any]) -> list:
            return function(group, *more)

        try:
            found = self._context.parallelize(wave, len(wave)).map(call).collect()
        except Exception as why:  # noqa: BLE001 - py4j's errors have no base of their own
            raise FleetError(f"Spark can't do it: {_cause(why)}") from None
        yield from zip(wave, found)


def _cause(why: BaseException) -> str:
    """The line that names the error among those of Python and of Java."""
    lines = [line for line in str(why).splitlines() if re.match(r"[\w.]+(Error|Exception): ", line)]
    return lines[0].rstrip(".") if lines else first_line(why)


def run(
    session: Any, logs: str | os.PathLike[str], out: str | os.PathLike[str], **words: Any
) -> Outcome:
    """Counts the logs of a fleet on a Spark session, as `plumb.fleet.run` does; its words but
    `scheduler` and `workers`.

    Errors: `FleetError`.
    """
    return run_on(logs, out, scheduler=Spark(session), **words)
