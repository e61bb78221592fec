"""Of which machine and day each log counts, and which of several equal ones.

In: a log, what it has come to, and where its content counts already. Out: its line, with status and
sentence, and its part in a machine's day.

Left out: reading (`work`), writing (`store`), and the order of the logs (`scratch`).
"""

from __future__ import annotations

import dataclasses
import datetime
from dataclasses import dataclass

from .layout import Log
from .store import Line
from .work import HERE, Read

DAY_NS = 86_400_000_000_000


@dataclass(frozen=True, slots=True)
class Entry:
    """A log and what it has come to."""

    log: Log
    read: Read
    gone: bool = False
    """It was there in an earlier run and is not now."""


@dataclass(frozen=True, slots=True)
class Part:
    """A log of a machine's day."""

    day: str
    machine: str
    blake3: str
    name: str


def left_over(line: Line, read: Read, sentence: str | None = None) -> Entry:
    """A log of an earlier run that is no longer there, or can't be read now for the reason in
    `sentence`; what it came to still counts."""
    if sentence is not None and read.error is None:
        read = in_force(read, f"{HERE}: {sentence}")
    log = Log(
        line.log, line.machine or "", line.path_day, line.size or 0, line.stamp or "", True
    )
    return Entry(log, read, gone=True)


def in_force(read: Read, sentence: str) -> Read:
    """What a log had come to before it could not be read any more."""
    before = f"{sentence}; what was read of it before counts"
    return dataclasses.replace(read, settled=False, incomplete=before)


def filed(
    entry: Entry, note: str | None, twin: str | None, key: str
) -> tuple[Line | None, Part | None]:
    """The line of a log, and its part in a day where it counts.

    `note` is what else is to be said of the log, and `twin` the log of the same content that
    counts. A content counts once: for the first log in the order in which they are filed. One that
    is gone and has a twin needs no line.
    """
    log, read = entry.log, entry.read
    if twin is not None and (read.error is None or entry.gone):
        why = f"has the same content as {twin}: counted once"
        return None if entry.gone else _line(entry, key, None, "duplicate", why), None
    day, said = _day(log, read)
    status, sentence = _verdict(entry, said)
    if day is not None and note is not None:
        sentence = _joined(sentence, note)
    line = _line(entry, key, day, status, sentence)
    if day is None or read.blake3 is None:
        return line, None
    return line, Part(day, log.machine, read.blake3, log.name)


def _verdict(entry: Entry, note: str | None) -> tuple[str, str | None]:
    """Status and sentence of a log that is no duplicate."""
    url, read = entry.log.url, entry.read
    if read.error is not None:
        return "failed", read.error.replace(HERE, url)
    if read.incomplete is not None:
        sentence = read.incomplete.replace(HERE, url)
        return "incomplete", sentence if note is None else _joined(sentence, note)
    if note is not None and note.startswith("has no date"):
        return "failed", note
    return "counted", note


def _joined(sentence: str | None, note: str) -> str:
    return note if sentence is None else f"{sentence}; {note}"


def _day(log: Log, read: Read) -> tuple[str | None, str | None]:
    """The day that a log counts for, and a sentence where that needs one.

    The day of the path, as long as a frame is within a day of it, so in any time zone; a log
    without dates has that alone.
    """
    if read.error is not None:
        return None, None
    if read.first_ns is None or read.last_ns is None:
        note = None if log.day else "has no date, and its path has no day: put {day} in --pattern"
        return log.day, note
    ends_ns = (read.first_ns, read.last_ns)
    own = [datetime.date(1970, 1, 1) + datetime.timedelta(ns // DAY_NS) for ns in ends_ns]
    if log.day is None:
        return own[0].isoformat(), None
    filed, near = datetime.date.fromisoformat(log.day), datetime.timedelta(1)
    if own[0] - near <= filed <= own[1] + near:
        return log.day, None
    return own[0].isoformat(), (
        f"its frames begin on {own[0]}, and its path has {log.day}: counted on {own[0]}"
    )


def _line(entry: Entry, key: str, day: str | None, status: str, sentence: str | None) -> Line:
    log, read = entry.log, entry.read
    return Line(
        log=log.url,
        key=key,
        status=status,
        sentence=sentence,
        machine=log.machine,
        day=day,
        frames=read.frames,
        size=log.size,
        blake3=read.blake3,
        stamp=log.stamp if read.settled else None,
        path_day=log.day,
    )


def replaced(entry: Entry, by: str, key: str) -> Line:
    """The line of a log that is gone, since another one has its beginning or all of it."""
    why = f"is gone, and {by} has the same beginning or all of it: counted once"
    return _line(entry, key, None, "duplicate", why)
