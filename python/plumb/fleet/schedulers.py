"""Where the work is done: in this process, in processes of this machine, or on a Dask cluster.

In: a function of a list of jobs, and the jobs with their sizes. Out: what came of them, as it comes.
Jobs go out in groups, so many at a time that neither the scheduler's nor this process's memory
grows with their number. A job whose worker is lost is done again elsewhere; what loses its worker
time and again is listed with its sentence.

Left out: what the jobs are (`work`), and the processes of this machine (`processes`).
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import logging
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Protocol

from .errors import FleetError, first_line

GROUP_BYTES = 32 << 20
"""Jobs go out in groups of about this many bytes."""

GROUP = 64
"""Jobs of a group, at most."""

AHEAD = 2
"""Groups that wait for each worker."""

KEPT = 10
"""Messages of each connection that Dask keeps to look for errors; as delivered 1000, with all that
is in them, and summaries are."""

ANSWER_S = 10.0
"""A scheduler has to answer within this time, s."""

WORKERLESS_S = 30.0
"""A scheduler without workers is told after this time, s."""

LOOK_S = 1.0
"""Time between two looks at the workers, s."""

OWN = (
    "the scheduler needs a map(function, jobs, *more) that takes (job, bytes) and yields each list "
    "of jobs with function(list, *more)"
)
"""The sentence on a scheduler of a caller that is none."""

Function = Callable[..., list]


class Place(Protocol):
    """Where work is done."""

    def map(
        self, function: Function, jobs: Iterable[tuple[Any, int]], *more: Any
    ) -> Iterator[tuple[list[Any], list | Exception]]:
        """Calls the function with lists of the jobs; each list with what came of it, in any order.

        Jobs have their bytes with them, and are taken as they are needed.
        """


def groups(jobs: Iterable[tuple[Any, int]], most_bytes: int = GROUP_BYTES) -> Iterator[list[Any]]:
    """Jobs with their bytes, in groups that keep their order."""
    group: list[Any] = []
    held = 0
    for job, size in jobs:
        if group and (held + size > most_bytes or len(group) >= GROUP):
            yield group
            group, held = [], 0
        group.append(job)
        held += size
    if group:
        yield group


class Here:
    """This process."""

    def map(
        self, function: Function, jobs: Iterable[tuple[Any, int]], *more: Any
    ) -> Iterator[tuple[list[Any], list]]:
        """Each group with what came of it."""
        for job, _ in jobs:
            yield [job], function([job], *more)


class Own:
    """A caller's own scheduler.

    Errors of `map`: `FleetError` where it is not as `Place` has it.
    """

    def __init__(self, place: Place) -> None:
        self._place = place

    def map(
        self, function: Function, jobs: Iterable[tuple[Any, int]], *more: Any
    ) -> Iterator[tuple[list[Any], list | Exception]]:
        """Each group with what came of it."""
        sent: Counter[Any] = Counter()
        given = _noted(jobs, sent)
        try:
            found = iter(self._place.map(function, given, *more))
        except (AttributeError, TypeError) as why:
            raise FleetError(f"{OWN} ({first_line(why)})") from None
        for pair in found:
            try:
                group, outcome = pair
                fits = isinstance(outcome, Exception) or len(outcome) == len(group)
                came = Counter(group)
            except (TypeError, ValueError):
                fits = False
            if not fits:
                raise FleetError(OWN)
            if any(sent[job] < count for job, count in came.items()):
                raise FleetError(f"the scheduler's map has yielded a job twice: {OWN}")
            for job, count in came.items():
                sent[job] -= count
                if not sent[job]:
                    del sent[job]
            yield group, outcome
        if left := sent.total() + sum(1 for _ in given):
            raise FleetError(f"the scheduler's map has not yielded {left} of the jobs: {OWN}")


def _noted(jobs: Iterable[tuple[Any, int]], sent: Counter[Any]) -> Iterator[tuple[Any, int]]:
    """The jobs, each counted in `sent` when it is taken."""
    for job, size in jobs:
        sent[job] += 1
        yield job, size


class Dask:
    """The workers of a Dask scheduler."""

    def __init__(self, client: Any, address: str) -> None:
        self._client = client
        self._address = address

    @property
    def workers(self) -> int:
        """How many there are by now."""
        return max(1, len(self._client.scheduler_info(n_workers=-1)["workers"]))

    def map(
        self, function: Function, jobs: Iterable[tuple[Any, int]], *more: Any
    ) -> Iterator[tuple[list[Any], list | Exception]]:
        """Each group with what came of it, in any order; an exception where its worker was lost
        every time."""
        with self._watched():
            yield from self._map(function, jobs, *more)

    def _map(
        self, function: Function, jobs: Iterable[tuple[Any, int]], *more: Any
    ) -> Iterator[tuple[list[Any], list | Exception]]:
        from distributed import as_completed
        from distributed.client import CancelledError
        from distributed.scheduler import KilledWorker

        waiting = groups(jobs)
        under_way: dict[str, list[Any]] = {}
        suspects: list[Any] = []
        done = as_completed(loop=self._client.loop)

        def start(group: list[Any]) -> None:
            future = self._client.submit(function, group, *more, pure=False)
            under_way[future.key] = group
            done.add(future)

        try:
            for group in _first(waiting, AHEAD * self.workers):
                start(group)
            for future in done:
                group = under_way.pop(future.key)
                why = future.exception()
                if isinstance(why, KilledWorker):
                    suspects += group
                else:
                    yield group, self._result(future, why, KilledWorker)
                future.release()
                for more_work in _first(waiting, 1):
                    start(more_work)
            # Each alone, so that none is blamed for what another one did to its worker.
            for job in suspects:
                future = self._client.submit(function, [job], *more, pure=False)
                yield [job], self._result(future, future.exception(), KilledWorker)
        except (OSError, CancelledError, asyncio.CancelledError) as why:
            raise FleetError(self._lost(why)) from None

    @contextlib.contextmanager
    def _watched(self) -> Iterator[None]:
        """A sentence on the standard error where all workers are gone for a while meanwhile."""
        done = threading.Event()

        def watch() -> None:
            since_s = time.monotonic()
            while not done.wait(LOOK_S):
                if self._client.scheduler_info(n_workers=-1).get("workers"):
                    since_s = time.monotonic()
                elif time.monotonic() - since_s > WORKERLESS_S:
                    said = f"the scheduler {self._address} has no worker: waiting for one"
                    print(f"plumb.fleet: {said}", file=sys.stderr, flush=True)
                    since_s = float("inf")

        thread = threading.Thread(target=watch, daemon=True)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()

    def _result(self, future: Any, why: BaseException | None, killed: type) -> list | Exception:
        if why is None:
            return future.result()
        from distributed.client import CancelledError

        if isinstance(why, killed):
            return FleetError("its worker was lost each time: look at the memory of the workers")
        if isinstance(why, ImportError):
            raise FleetError(
                f"a worker of {self._address} can't load the package: install plumb[fleet] there "
                f"({first_line(why)})"
            )
        if isinstance(why, (CancelledError, asyncio.CancelledError, OSError)):
            raise FleetError(self._lost(why))
        raise why

    def _lost(self, why: BaseException) -> str:
        return (
            f"the scheduler {self._address} was lost ({first_line(why)}): run again, what is finished "
            "is not done again"
        )


def _first(waiting: Iterator[Any], count: int) -> Iterator[Any]:
    for _, one in zip(range(count), waiting):
        yield one


@contextlib.contextmanager
def opened(scheduler: str | Place | None, workers: int) -> Iterator[Place]:
    """A scheduler: that at an address, or so many processes of this machine, or this process.

    Errors: `FleetError` where none answers, or Dask is not installed.
    """
    if scheduler is None and workers <= 1:
        yield Here()
        return
    if scheduler is not None and not isinstance(scheduler, str):
        yield Own(scheduler)
        return
    try:
        from . import processes
    except ImportError:
        raise FleetError("Dask is not installed: type pip install 'plumb[fleet]'") from None
    with _quiet(), contextlib.ExitStack() as stack:
        address = stack.enter_context(processes.local(workers)) if scheduler is None else scheduler
        client = stack.enter_context(_client(address))
        try:
            client.wait_for_workers(workers if scheduler is None else 1, timeout=3 * ANSWER_S)
        except (TimeoutError, OSError):
            raise FleetError(f"the scheduler {address} has no worker: start one there") from None
        yield Dask(client, address)


@contextlib.contextmanager
def _client(address: str) -> Iterator[Any]:
    import dask
    from distributed import Client
    from distributed.comm import get_address_host_port

    try:
        get_address_host_port(address)
    except ValueError:
        raise FleetError(
            f"{address!r} is no address of a Dask scheduler: write it as tcp://host:8786"
        ) from None
    try:
        # A client waits for ever where something listens that never sends a word.
        with concurrent.futures.ThreadPoolExecutor(1) as beside:
            beside.submit(asyncio.run, _greet(address)).result()
        with dask.config.set({"distributed.admin.low-level-log-length": KEPT}):
            client = Client(address, timeout=ANSWER_S, set_as_default=False)
    except Exception:  # noqa: BLE001 - what is no scheduler may answer anything
        raise FleetError(
            f"no Dask scheduler answers at {address}: start one, check the address, or leave "
            "--scheduler out"
        ) from None
    try:
        yield client
    finally:
        # After an interruption it may wait in vain for what is gone.
        with contextlib.suppress(TimeoutError, asyncio.TimeoutError, OSError):
            client.close()


async def _greet(address: str) -> None:
    """Connects to a scheduler, and leaves.

    Errors: `OSError` or a time-out where none answers.
    """
    from distributed import Security
    from distributed.comm import connect

    words = Security().get_connection_args("client")
    comm = await asyncio.wait_for(connect(address, timeout=ANSWER_S, **words), ANSWER_S)
    await comm.close()


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Without the log messages of Dask: an error is one sentence."""
    loud = [logging.getLogger(name) for name in ("distributed", "tornado.application")]
    levels = [logger.level for logger in loud]
    for logger in loud:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loud, levels):
            logger.setLevel(level)
