"""Dask's processes on this machine, which end with the process that has started them.

In: how many workers. Out: the address of their scheduler. They are the processes of
`distributed.deploy.subprocess`, with a thread in each that watches the process that has started
them, since that can't end them where it is killed.

Left out: what they are used for (`schedulers`).
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import pathlib
import sys
from collections.abc import Iterator
from typing import Any

from distributed.deploy.spec import SpecCluster
from distributed.deploy.subprocess import SubprocessScheduler, SubprocessWorker

from .errors import FleetError, first_line
from .schedulers import KEPT

SCHEDULER = "distributed.Scheduler"

START_S = 30.0
"""A scheduler has to start within this time, s."""

LOOK_S = 0.05
"""Time between two looks for its address, s."""

CALM = {
    "DASK_DISTRIBUTED__ADMIN__LOW_LEVEL_LOG_LENGTH": str(KEPT),
    "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "1s",
    "DASK_DISTRIBUTED__ADMIN__SYSTEM_MONITOR__INTERVAL": "10s",
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
}
"""How little Dask's processes of this machine keep, and how often they look at themselves; as
delivered that takes 4 % of two processors."""

PROGRAM = """
import os
import threading
import time

def watch():
    while os.getppid() == {parent}:
        time.sleep({every_s})
    os._exit(1)

threading.Thread(target=watch, daemon=True).start()
from distributed.cli.dask_spec import main
main()
"""
"""A process of Dask that ends when its parent has ended. A worker ends with its nanny by itself."""

WATCH_S = 0.5
"""Time between two looks at the parent, s."""


class _Scheduler(SubprocessScheduler):
    """A scheduler as a process."""

    async def _start(self) -> None:
        self.process = await _process(SCHEDULER, self.scheduler_kwargs)
        file = pathlib.Path(self.scheduler_kwargs["scheduler_file"])
        try:
            self.address = await asyncio.wait_for(_address(file), START_S)
        finally:
            file.unlink(missing_ok=True)


class _Worker(SubprocessWorker):
    """A nanny as a process, which starts its worker again where that is lost."""

    async def _start(self) -> None:
        self.process = await _process(self.worker_class, self.worker_kwargs, self.scheduler)


async def _process(kind: str, options: dict[str, Any], *words: str) -> asyncio.subprocess.Process:
    """Starts an object of Dask in a process of its own."""
    program = PROGRAM.format(parent=os.getpid(), every_s=WATCH_S)
    spec = json.dumps({"cls": kind, "opts": options})
    command = [sys.executable, "-c", program, *words, "--spec", spec]
    # What a scheduler reports the client has as an error.
    nothing = asyncio.subprocess.DEVNULL if kind == SCHEDULER else None
    return await asyncio.create_subprocess_exec(*command, stderr=nothing)


async def _address(file: pathlib.Path) -> str:
    """The address of a scheduler, out of the file that it writes."""
    while True:
        # The file may not be there yet, or not be complete.
        with contextlib.suppress(OSError, ValueError, KeyError):
            address: str = json.loads(file.read_text())["address"]
            return address
        await asyncio.sleep(LOOK_S)


@contextlib.contextmanager
def local(workers: int) -> Iterator[str]:
    """Processes of this machine with a scheduler of their own; its address.

    They are programs and no forks, so that a script needs no guard around its call.
    """
    options = {"scheduler_kwargs": {"host": "127.0.0.1", "dashboard": False}}
    words: dict[str, Any] = {"host": "127.0.0.1", "nthreads": 1, "dashboard": False}
    words |= {"memory_limit": 0, "silence_logs": logging.CRITICAL}
    worker = {"cls": _Worker, "options": {"worker_kwargs": words}}
    try:
        with _environment(CALM):
            cluster = SpecCluster(
                workers=dict.fromkeys(range(workers), worker),
                scheduler={"cls": _Scheduler, "options": options},
                name="plumb",
                silence_logs=logging.CRITICAL,
            )
    except (OSError, RuntimeError, TimeoutError, asyncio.TimeoutError) as why:
        raise FleetError(
            f"the processes of Dask can't be started ({first_line(why)}): give --workers 1"
        ) from None
    try:
        yield cluster.scheduler_address
    finally:
        with contextlib.suppress(TimeoutError, asyncio.TimeoutError, OSError):
            cluster.close()


@contextlib.contextmanager
def _environment(variables: dict[str, str]) -> Iterator[None]:
    """Variables for the processes that are started meanwhile; one that is set already stays."""
    added = {name: text for name, text in variables.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]
