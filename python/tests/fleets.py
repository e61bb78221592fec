"""What the tests of the fleet share: recordings, trees of logs, and what a run has written."""

from __future__ import annotations

import datetime
import functools
import os
import pathlib

from conftest import candump, shift

import plumb

FILES = ("report.html", "report.json", "machines.parquet")


@functools.cache
def frames(seed: int, words: str = "") -> tuple[plumb.Frame, ...]:
    """Two seconds of a machine."""
    return tuple(shift(seed, 2.0, words))


def text(day: str, seed: int = 1, words: str = "", hour: int = 8) -> str:
    """A log of a day."""
    at = datetime.datetime.fromisoformat(day).replace(tzinfo=datetime.timezone.utc)
    return candump(list(frames(seed, words)), at.timestamp() + hour * 3600)


def put(path: pathlib.Path, content: str | bytes, age_s: float = 1000.0) -> pathlib.Path:
    """A file that was written so long ago."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    written_s = 1_790_000_000.0 - age_s
    os.utime(path, (written_s, written_s))
    return path


def tree(root: pathlib.Path, machines: int = 3, days: int = 4) -> pathlib.Path:
    """Logs of some machines and days; on the last days the last machine has a stuck sensor."""
    for machine in range(machines):
        for day in range(days):
            date = f"2026-11-{20 + day}"
            is_broken = machine == machines - 1 and day >= days - 2
            words = "+1 s fault b stuck" if is_broken else ""
            put(root / f"m{machine + 1}" / f"{date}.log", text(date, machine + 1, words))
    return root


def results(out: pathlib.Path) -> dict[str, bytes]:
    """The bytes of all results in a folder, by name."""
    found = [out / name for name in FILES]
    for kind in ("figures", "summaries", "machines"):
        found += sorted((out / kind).rglob("*.*"))
    return {str(path.relative_to(out)): path.read_bytes() for path in found if path.is_file()}
