"""What a worker does: a log to its summary, and the summaries of a machine's day to one.

In: a `Log` and how it is to be read, or summaries. Out: plain values that can be sent. Nothing is
written here, and a log that can't be read is a result as any other, with its sentence; so a worker
may be lost and its work be done again elsewhere.

Left out: who calls it (`schedulers`, `spark`), and what is done with it (`store`).
"""

from __future__ import annotations

import gzip
import hashlib
import json
import os
import pathlib
import shutil
import tempfile
import time
import zlib
from dataclasses import dataclass
from typing import Any, Optional

import fsspec

from .. import _plumb
from .errors import FleetError, first_line
from .figures import rows
from .layout import Log

PIECE = 1 << 20
"""Bytes that are read at once."""

SETTLED_S = 2.0
"""A file that was written less than this before it was read may be written again unseen."""

GZIP = b"\x1f\x8b"
"""What a compressed file begins with (RFC 1952)."""

HERE = "\0"
"""Stands for the log's own place in a sentence, which is kept by content."""


@dataclass(frozen=True)
class How:
    """How logs are read: node-ids A, B, A, B, and data sheets, as `plumb.summarise` takes them."""

    nodes: tuple[int, ...] = ()
    eds: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """Stands for this reading: the same log read otherwise has another summary."""
        known = hashlib.sha256(json.dumps(self.nodes).encode())
        for sheet in self.eds:
            path, at, node = sheet.rpartition("@")
            path = path if at and node.isdigit() else sheet
            known.update(pathlib.Path(path).read_bytes() + node.encode())
        return known.hexdigest()[:12]


@dataclass(frozen=True, slots=True)
class Read:
    """What a log has come to; `summary` or `error` is there, never both."""

    blake3: str | None
    """Of the bytes of the file; None where they can't be read, or change while they are."""
    settled: bool
    """Whether size and stamp of the file stand for its content from now on."""
    frames: int = 0
    first_ns: int | None = None
    last_ns: int | None = None
    summary: bytes | None = None
    """Compressed."""
    incomplete: str | None = None
    """The sentence on what could not be read."""
    error: str | None = None
    """The sentence on why there is no summary."""
    content: str | None = None
    """BLAKE3 of what is in a compressed log, and of another log as it is; None where that was not
    looked for, since no other log has as many frames of the same time."""


def refuse(how: How) -> None:
    """Refuses data sheets that no log can be read with; a frame is read to see that.

    Errors: `FleetError`.
    """
    if not how.eds:
        return
    with tempfile.TemporaryDirectory(prefix="plumb-") as folder:
        path = pathlib.Path(folder, "log")
        path.write_text("(1.000000) can0 000#8000\n")
        try:
            error = _plumb.count(str(path), list(how.eds), list(how.nodes)).error
        except _plumb.Error as why:
            error = str(why)
    if error is not None:
        raise FleetError(error)


def pack(summary: bytes) -> bytes:
    """A summary as it is stored and sent."""
    return zlib.compress(summary, 1)


def unpack(packed: bytes) -> bytes:
    """A summary that was packed. Errors: zlib.error."""
    return zlib.decompress(packed)


def read(log: Log, how: How) -> Read:
    """Counts a log; whatever is wrong with it is in the result."""
    try:
        if log.local:
            return _read_local(log, how)
        with tempfile.TemporaryDirectory(prefix="plumb-") as folder:
            return _read_remote(log, how, pathlib.Path(folder))
    except Exception as why:  # noqa: BLE001 - one log, however odd, must not end a run
        return Read(None, False, error=f"{HERE} can't be read: {first_line(why)}")


def read_all(logs: list[Log], how: How) -> list[Read]:
    """Counts some logs, one after the other."""
    return [read(log, how) for log in logs]


@dataclass(frozen=True, slots=True)
class Content:
    """What is in a log."""

    blake3: str | None
    """Of the bytes that are in the file; None where it has changed since it was listed."""
    error: str | None = None
    """The sentence on why that is not known."""


def contents(logs: list[tuple[Log, str]]) -> list[Content]:
    """What is in each log, given the log and the hash of its file: that of other bytes where the
    file is compressed and whole."""
    return [_content_in_words(log, blake3) for log, blake3 in logs]


def _content_in_words(log: Log, blake3: str) -> Content:
    try:
        return Content(_content(log, blake3))
    except Exception as why:  # noqa: BLE001 - whatever it is, the log counts, and is listed
        reason = getattr(why, "strerror", None) or first_line(why)
        return Content(None, not_compared(reason))


def not_compared(reason: str) -> str:
    """The sentence on a log that may be the same as another one."""
    return f"{HERE} may count twice, as it could not be unpacked and compared: {reason}"


def _content(log: Log, blake3: str) -> str | None:
    with _opened(log) as file:
        if file.read(len(GZIP)) != GZIP:
            return blake3
    with tempfile.TemporaryDirectory(prefix="plumb-") as folder:
        path = pathlib.Path(folder, "log")
        if not _unpacked(log, path):
            return blake3
        counted = _plumb.count(str(path), [], [])
    is_same = not log.local or str(os.stat(log.url).st_mtime) == log.stamp
    return counted.blake3 if is_same else None


def _opened(log: Log) -> Any:
    """A log, opened. On this machine "::" may be in a name; in a URL it chains several."""
    return open(log.url, "rb") if log.local else fsspec.open(log.url, "rb")


def _unpacked(log: Log, path: pathlib.Path) -> bool:
    """Writes what is in a compressed log to a file; whether it is whole."""
    try:
        with _opened(log) as packed, gzip.open(packed) as source:
            with path.open("wb") as copy:
                shutil.copyfileobj(source, copy, PIECE)
    except (EOFError, zlib.error, gzip.BadGzipFile):
        return False
    return True


def _read_local(log: Log, how: How) -> Read:
    before = os.stat(log.url)
    counted = _count(log.url, how)
    after = os.stat(log.url)
    if (before.st_size, before.st_mtime_ns) != (after.st_size, after.st_mtime_ns):
        error = f"{HERE} is being written: the next run counts it"
        return Read(None, False, error=error)
    settled = time.time() - after.st_mtime > SETTLED_S and str(after.st_mtime) == log.stamp
    return Read(settled=settled, **counted)


def _read_remote(log: Log, how: How, folder: pathlib.Path) -> Read:
    path = folder / (log.name or "log")
    with _opened(log) as source, path.open("wb") as copy:
        shutil.copyfileobj(source, copy, PIECE)
    settled = path.stat().st_size == log.size and log.stamp != ""
    return Read(settled=settled, **_count(str(path), how))


def _count(path: str, how: How) -> dict[str, Any]:
    counted = _plumb.count(path, list(how.eds), list(how.nodes))
    incomplete, error = counted.incomplete, counted.error
    return {
        "blake3": counted.blake3,
        "frames": counted.frames,
        "first_ns": counted.first_ns,
        "last_ns": counted.last_ns,
        "summary": None if counted.summary is None else pack(counted.summary),
        "incomplete": None if incomplete is None else incomplete.replace(path, HERE),
        "error": None if error is None else error.replace(path, HERE),
    }


Part = tuple[bytes, Optional[str]]
"""A packed summary with the name of its log, or without one where it is of several logs."""


@dataclass(frozen=True)
class Day:
    """The logs of a machine's day, or some of them."""

    machine: str
    day: str
    parts: tuple[Part, ...]


@dataclass(frozen=True)
class Counted:
    """A machine's day: its summary, packed, and its rows of figures."""

    machine: str
    day: str
    summary: bytes
    rows: list[dict[str, Any]]


def join(days: list[Day]) -> list[Counted]:
    """Merges the summaries of each day, and takes the figures out of them.

    Errors: `plumb.Error` where one is no summary.
    """
    joined = []
    for day in days:
        summary = _merged(day)
        figures = rows(day.machine, day.day, _plumb.figures(summary))
        joined.append(Counted(day.machine, day.day, pack(summary), figures))
    return joined


def fold(days: list[Day]) -> list[Counted]:
    """Merges some of the summaries of each day; figures are of whole days alone.

    Errors: `plumb.Error` where one is no summary.
    """
    return [Counted(day.machine, day.day, pack(_merged(day)), []) for day in days]


def _merged(day: Day) -> bytes:
    named = [(unpack(packed), name) for packed, name in day.parts if name is not None]
    others = [unpack(packed) for packed, name in day.parts if name is None]
    if not others:
        return _plumb.merge_named(named)
    return _plumb.merge(others + ([_plumb.merge_named(named)] if named else []))
