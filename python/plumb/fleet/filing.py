"""Of which machine and day each log counts, and which of several equal ones.

In: the logs that were found, what each has come to, and the lines of the last run. Out: a line for
each log, with its status and its sentence, and the logs of each machine's day.

Left out: reading (`work`) and writing (`store`).
"""

from __future__ import annotations

import datetime
import sys
from collections import defaultdict
from dataclasses import dataclass, replace

from .layout import Log
from .store import Line
from .work import HERE, Read

DAY_NS = 86_400_000_000_000

Parts = list[tuple[str, str]]
"""Of a machine's day: content and name of each log."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A log and what it has come to."""

    log: Log
    read: Read
    gone: bool = False
    """It was there in an earlier run and is not now."""


def left_over(line: Line, read: Read) -> Entry:
    """A log of an earlier run that is no longer there; what it came to still counts."""
    log = Log(
        line.log, line.machine or "", line.path_day, line.size or 0, line.stamp or "", True
    )
    return Entry(log, read, gone=True)


def file(
    entries: list[Entry], strays: dict[str, str], notes: dict[str, str], key: str
) -> tuple[list[Line], dict]:
    """A line for each log, and `{day: {machine: parts}}`.

    A content counts once: for the first log in the order of their URLs, those that are there before
    those that are gone.
    """
    lines = [Line(url, key, "stray", why) for url, why in strays.items()]
    days: dict[str, dict[str, Parts]] = defaultdict(lambda: defaultdict(list))
    first: dict[str, Log] = {}
    for entry in sorted(entries, key=lambda entry: (entry.gone, entry.log.url)):
        log, read = entry.log, entry.read
        twin = first.get(read.blake3) if read.blake3 and read.error is None else None
        if twin is not None:
            if not entry.gone:
                sentence = f"has the same content as {twin.url}: counted once"
                lines.append(_line(entry, key, None, "duplicate", sentence))
            continue
        day, note = _day(log, read)
        status, sentence = _verdict(entry, note)
        if day is not None and log.url in notes:
            sentence = _joined(sentence, notes[log.url])
        lines.append(_line(entry, key, day, status, sentence))
        if day is not None and read.blake3 is not None:
            first[read.blake3] = log
            # Logs of many machines have the same name: it is held once.
            days[day][log.machine].append((read.blake3, sys.intern(log.name)))
    for machines in days.values():
        for parts in machines.values():
            parts.sort()
    return lines, days


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
        return sys.intern(own[0].isoformat()), None
    filed, near = datetime.date.fromisoformat(log.day), datetime.timedelta(1)
    if own[0] - near <= filed <= own[1] + near:
        return log.day, None
    return sys.intern(own[0].isoformat()), (
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


def without_summary(read: Read) -> Read:
    """The same without the summary, which is kept elsewhere."""
    return replace(read, summary=None)
