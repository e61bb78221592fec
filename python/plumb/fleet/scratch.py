"""What a run has to keep of each log while it lasts: tables in a temporary file.

In: logs and strays as they are found, lines of earlier runs, and what logs and days have come to.
Out: the same in the order that is asked for, a row at a time, so that memory does not grow with the
number of logs. SQLite keeps the file below `SQLITE_TMPDIR`, `TMPDIR` or `/var/tmp` and removes it
at the end, also of a run that is killed; nothing in it is needed afterwards.

Left out: what is kept between runs (`store`), and what is decided (`filing`, `runs`, `merging`).
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import sqlite3
from collections.abc import Iterable, Iterator
from typing import Any

from .errors import FleetError
from .filing import Entry, Part
from .layout import About, Log, Stray
from .store import Line
from .work import Counted, Read

CACHE_KB = 1024
"""Memory for pages of the file, kB; sorting takes as much again."""

BEFORE = ("log", "machine", "day", "size", "blake3", "stamp", "path_day", "key")
"""What is taken of a line of an earlier run."""

TABLES = """
create table logs (url text primary key, machine, day, size, stamp, local) without rowid;
create table strays (url text primary key, sentence, should_be_log) without rowid;
create table notes (url text primary key, sentence) without rowid;
create table machines (machine text primary key, about) without rowid;
create table before (log text primary key, machine, day, size, blake3, stamp, path_day, key)
    without rowid;
create table known (log text primary key, stamp, size, key, blake3) without rowid;
create table todo (url text primary key) without rowid;
create table entries (url text primary key, machine, day, size, stamp, local, gone,
    blake3, settled, frames, first_ns, last_ns, incomplete, error, content) without rowid;
create index files on entries (blake3);
create index spans on entries (frames, first_ns, last_ns);
create index begins on entries (machine, first_ns);
create table lines (log text, key, status, sentence, machine, day, frames, size, blake3, stamp,
    path_day);
create table parts (day text, machine text, blake3 text, name text, content text, url,
    primary key (day, machine, blake3)) without rowid;
create unique index once on parts (content);
create index own on parts (url);
create table pieces (day text, machine text, level, summary);
create index piece on pieces (day, machine, level);
create table damaged (blake3 text primary key) without rowid;
create table merged (day text, machine text, summary, rows, primary key (day, machine))
    without rowid;
"""


@dataclasses.dataclass(frozen=True)
class Told:
    """What the page and the caller are told about the lines of a run."""

    counted: int
    """Logs that count."""
    frames: int
    bad: int
    """Logs that could not be read, or not to the end."""
    noted: int
    """Lines with a sentence."""
    listed: list[Line]
    """The first of them, the worst before the others."""


@contextlib.contextmanager
def opened() -> Iterator[Scratch]:
    """The tables of one run, empty.

    Errors: `FleetError` where there is no room for them.
    """
    # Places may take jobs in a thread of their own; SQLite lets one call in at a time.
    base = sqlite3.connect("", isolation_level=None, check_same_thread=False)
    try:
        # A file that nobody opens again needs neither a journal nor to be on the disk.
        base.executescript(
            f"pragma cache_size = -{CACHE_KB}; pragma temp_store = file; "
            f"pragma journal_mode = off; pragma synchronous = off; {TABLES}"
        )
        yield Scratch(base)
    except sqlite3.Error as why:
        raise FleetError(
            f"the temporary file of the run can't be used: {why}; make room in /var/tmp, or name "
            "another folder in SQLITE_TMPDIR"
        ) from None
    finally:
        base.close()


class Scratch:
    """The tables of one run."""

    def __init__(self, base: sqlite3.Connection) -> None:
        self._base = base

    def _one(self, text: str, *given: Any) -> Any:
        """The first value of a query's first row; None without one."""
        row = self._base.execute(text, given).fetchone()
        return None if row is None else row[0]

    # What is there.

    def add(self, found: Log | Stray | About) -> None:
        """Enters what was found.

        Errors: `FleetError` where a manifest states two things of a machine.
        """
        if isinstance(found, Log):
            self._add_log(found)
        elif isinstance(found, Stray):
            row = (found.url, found.sentence, found.should_be_log)
            self._base.execute("insert or replace into strays values (?, ?, ?)", row)
        else:
            self._add_about(found)

    def _add_log(self, log: Log) -> None:
        """Enters a log. Of two with the same place the first one counts, which is noted."""
        text = "insert or ignore into logs values (?, ?, ?, ?, ?, ?)"
        added = self._base.execute(text, _row(log))
        if added.rowcount:
            return
        first = self._one("select machine from logs where url = ?", log.url)
        whose = "" if log.machine == first else f", for {first}"
        note = f"the manifest lists it twice: counted once{whose}"
        self._base.execute("insert or ignore into notes values (?, ?)", (log.url, note))

    def _add_about(self, about: About) -> None:
        """Enters what a manifest has on a machine; a row without a value changes none.

        Errors: `FleetError` where another row has another value.
        """
        text = self._one("select about from machines where machine = ?", about.machine)
        known: dict[str, str] = {} if text is None else json.loads(text)
        if text is not None and about.values.items() <= known.items():
            return
        for name, value in about.values.items():
            if known.setdefault(name, value) != value:
                raise FleetError(
                    f"{about.manifest} has two values of {name} for {about.machine}: keep one"
                )
        row = (about.machine, json.dumps(known))
        self._base.execute("insert or replace into machines values (?, ?)", row)

    def add_known_machines(self, rows: Iterable[dict[str, Any]]) -> None:
        """Enters what earlier manifests had, where the one of this run has nothing."""
        given = ((row.pop("machine"), json.dumps(row)) for row in rows)
        self._base.executemany("insert or ignore into machines values (?, ?)", given)

    def machines(self) -> Iterator[dict[str, Any]]:
        """Rows of machines.parquet, in the order of the names."""
        for machine, about in self._base.execute("select * from machines order by machine"):
            yield {"machine": machine} | json.loads(about)

    def leave_out(self, folders: Iterable[str]) -> None:
        """Takes out what lies below these folders of this machine."""
        for folder in folders:
            below = "substr(url, 1, length(?1)) = ?1"
            self._base.execute(f"delete from logs where local and {below}", (folder,))
            self._base.execute(f"delete from strays where {below}", (folder,))

    def has_logs(self) -> bool:
        """Whether there is a log."""
        return self._one("select exists (select 1 from logs)") == 1

    def strays(self) -> tuple[int, Stray | None]:
        """How many files of no machine there are, and the first of them."""
        first = self._base.execute("select * from strays order by url limit 1").fetchone()
        return self._one("select count(*) from strays"), first and Stray(*first)

    # What is finished.

    def add_before(self, lines: Iterable[Line]) -> None:
        """Enters the lines of the last run."""
        marks = ", ".join("?" * len(BEFORE))
        for line in lines:
            row = tuple(getattr(line, name) for name in BEFORE)
            self._base.execute(f"insert or replace into before values ({marks})", row)
            self.add_known(line)

    def add_known(self, line: Line) -> None:
        """Enters which content a log had, in place of what was entered before."""
        row = (line.log, line.stamp, line.size, line.key, line.blake3)
        self._base.execute("insert or replace into known values (?, ?, ?, ?, ?)", row)

    def logs(self, key: str) -> Iterator[tuple[Log, str | None]]:
        """All logs in the order of their URLs, each with its content where that is known from
        size and stamp, and was read in the same way."""
        text = """select logs.*, blake3 from logs left join known on log = url and logs.stamp <> ''
            and known.stamp = logs.stamp and known.size = logs.size and known.key = ?
            order by url"""
        for *log, blake3 in self._base.execute(text, (key,)):
            yield _log(log), blake3

    def gone(self) -> Iterator[tuple[Line, str | None]]:
        """Lines of the last run that counted, and whose logs are no longer there, or can't be read
        as they are now; then with the sentence on that."""
        text = f"""select {", ".join(BEFORE)}, sentence from before
            left join strays on url = log where day is not null
            and log not in (select url from logs) and (url is null or should_be_log)
            order by log"""
        for *row, sentence in self._base.execute(text):
            yield Line(**dict(zip(BEFORE, row))), sentence

    def earlier(self, log: Log) -> Line | None:
        """The line of the last run on a log, where it counted."""
        text = f"select {', '.join(BEFORE)} from before where log = ? and day is not null"
        row = self._base.execute(text, (log.url,)).fetchone()
        return row and Line(**dict(zip(BEFORE, row)))

    # What there is to read, and what it came to.

    def add_todo(self, log: Log) -> None:
        """Enters that a log has to be read."""
        self._base.execute("insert into todo values (?)", (log.url,))

    def end_todo(self) -> None:
        """All of it was read."""
        self._base.execute("delete from todo")

    def todo_size(self) -> tuple[int, int]:
        """Logs that have to be read, and their bytes."""
        text = "select count(*), coalesce(sum(size), 0) from logs join todo using (url)"
        count, size = self._base.execute(text).fetchone()
        return count, size

    def todo(self) -> Iterator[Log]:
        """They, in the order of their URLs."""
        text = "select logs.* from todo cross join logs using (url) order by url"
        return map(_log, self._base.execute(text))

    def add_entry(self, entry: Entry) -> None:
        """Enters what a log has come to, without the summary, in place of what it was before."""
        log, read = entry.log, entry.read
        # Times may be greater than SQLite's integers.
        times = [None if ns is None else str(ns) for ns in (read.first_ns, read.last_ns)]
        row = (*_row(log), entry.gone, read.blake3, read.settled, read.frames)
        row += (*times, read.incomplete, read.error, read.content)
        marks = ", ".join("?" * len(row))
        self._base.execute(f"insert or replace into entries values ({marks})", row)

    def entries(self) -> Iterator[tuple[Entry, str | None]]:
        """All of them, those that are gone last, in the order of their URLs; each with its note."""
        text = """select entries.*, sentence from entries left join notes using (url)
            order by gone, url"""
        for row in self._base.execute(text):
            yield _entry(row[:-1]), row[-1]

    def entry_count(self) -> int:
        """How many there are."""
        count: int = self._one("select count(*) from entries")
        return count

    # Which files have the same content though they are others.

    def add_alike(self) -> None:
        """Enters that there are logs to look into: those with as many frames of the same time as
        another file, which one of both may be when it is compressed."""
        self._base.execute(
            """insert into todo select min(url) from entries as own
            where not gone and blake3 <> '' and error is null and content is null and frames > 0
            and exists (select 1 from entries as other where other.frames = own.frames
                and other.first_ns is own.first_ns and other.last_ns is own.last_ns
                and other.blake3 <> own.blake3)
            group by blake3"""
        )

    def alike(self) -> Iterator[tuple[Log, str]]:
        """They, with the hash of each file."""
        text = """select logs.*, blake3 from todo cross join logs using (url)
            cross join entries using (url) order by url"""
        for *log, blake3 in self._base.execute(text):
            yield _log(log), blake3

    def add_content(self, blake3: str, content: str) -> None:
        """Enters what is in the logs whose files have this hash."""
        text = "update entries set content = ? where blake3 = ?"
        self._base.execute(text, (content, blake3))

    def add_incomplete(self, blake3: str, sentence: str) -> None:
        """Enters a sentence on the logs whose files have this hash, where they have none."""
        text = "update entries set incomplete = coalesce(incomplete, ?) where blake3 = ?"
        self._base.execute(text, (sentence, blake3))

    def successor(self, gone: Entry) -> str | None:
        """The log that has all of one that is gone, as it was renamed or compressed, also after it
        had grown: a new log of the machine that begins at the same instant and has as many frames
        or more; without dates one of the same name but for .gz, with as many frames."""
        read, log = gone.read, gone.log
        text = """select url, last_ns from entries cross join parts using (url)
            where entries.machine = ?1 and first_ns is ?2 and not gone and frames >= ?3
            and not exists (select 1 from before where log = url and before.blake3 = entries.blake3)
            and (?2 is not null or frames = ?3
                and replace(url, '.gz', '') = replace(?4, '.gz', ''))
            order by url"""
        first_ns = None if read.first_ns is None else str(read.first_ns)
        found = self._base.execute(text, (log.machine, first_ns, read.frames, log.url))
        ends = ((url, int(last_ns or 0)) for url, last_ns in found.fetchall())
        return next((url for url, last_ns in ends if last_ns >= (read.last_ns or 0)), None)

    # What is damaged.

    def add_damaged(self, blake3: str) -> None:
        """Enters a content whose summary can't be used."""
        self._base.execute("insert or ignore into damaged values (?)", (blake3,))

    def read_damaged_again(self, lost: Read) -> int:
        """Enters that the logs of damaged summaries have to be read; what is gone, and of which no
        other log has the content, is `lost`. How many have to be read."""
        self._base.execute(
            "insert into todo select url from entries join damaged using (blake3) where not gone"
        )
        text = """select entries.* from entries join damaged using (blake3)
            where blake3 not in (select blake3 from entries join todo using (url))"""
        # Few summaries are damaged at a time, and rows must not change while they are read.
        for row in self._base.execute(text).fetchall():
            self.add_entry(Entry(_entry(row).log, lost, gone=True))
        self._base.execute("delete from damaged")
        return self.todo_size()[0]

    # Lines, and what days consist of.

    def clear_lines(self) -> None:
        """Takes all lines and days out, so that they can be made anew."""
        for table in ("lines", "parts", "pieces", "merged"):
            self._base.execute(f"delete from {table}")

    def add_stray_lines(self, key: str) -> None:
        """Enters a line for each stray that has none."""
        text = """insert into lines (log, key, status, sentence)
            select url, ?, iif(should_be_log, 'failed', 'stray'), sentence from strays
            where url not in (select log from lines) order by url"""
        self._base.execute(text, (key,))

    def add_line(self, line: Line) -> None:
        """Enters a line."""
        row = tuple(getattr(line, name) for name in LINE)
        marks = ", ".join("?" * len(LINE))
        self._base.execute(f"insert into lines values ({marks})", row)

    def add_part(self, part: Part, entry: Entry) -> None:
        """Enters a log of a machine's day, with what it has come to."""
        row = (part.day, part.machine, part.blake3, part.name)
        row += (entry.read.content or part.blake3, entry.log.url)
        self._base.execute("insert into parts values (?, ?, ?, ?, ?, ?)", row)

    def twin(self, read: Read) -> str | None:
        """The log of the same content that counts."""
        text = "select url from parts where content = ?"
        found: str | None = self._one(text, read.content or read.blake3)
        return found

    def lines(self, *statuses: str) -> Iterator[Line]:
        """Lines of these statuses with a sentence, strays first and what is gone last."""
        marks = ", ".join("?" * len(statuses))
        text = f"select * from lines where sentence <> '' and status in ({marks}) order by rowid"
        return (Line(*row) for row in self._base.execute(text, statuses))

    def ledger(self) -> Iterator[Line]:
        """All lines, in the order of the logs."""
        return (Line(*row) for row in self._base.execute("select * from lines order by log, rowid"))

    def told(self, rows: int) -> Told:
        """The lines in sum, and so many of those with a sentence."""
        order = "instr('failed incomplete stray duplicate counted', status)"
        text = f"select * from lines where sentence <> '' order by {order}, log, rowid limit ?"
        listed = [Line(*row) for row in self._base.execute(text, (rows,))]
        text = """select
            coalesce(sum(status in ('counted', 'incomplete')), 0),
            coalesce(sum(frames * (status in ('counted', 'incomplete'))), 0),
            coalesce(sum(status in ('failed', 'incomplete')), 0),
            coalesce(sum(sentence <> ''), 0) from lines"""
        counted, frames, bad, noted = self._base.execute(text).fetchone()
        return Told(counted, frames, bad, noted, listed)

    def days(self) -> list[str]:
        """The days that logs count on."""
        return [day for [day] in self._base.execute("select distinct day from parts order by day")]

    def machine_count(self) -> int:
        """Machines of which a log counts."""
        count: int = self._one("select count(distinct machine) from parts")
        return count

    def parts(self, day: str, machine: str | None = None) -> Iterator[Part]:
        """The logs of a day, or of a machine's day, in the order of machines and contents."""
        given = (day,) if machine is None else (day, machine)
        own = "" if machine is None else "and machine = ?"
        text = f"""select day, machine, blake3, name from parts where day = ? {own}
            order by machine, blake3"""
        return (Part(*row) for row in self._base.execute(text, given))

    def machines_of(self, day: str) -> Iterator[tuple[str, int]]:
        """The machines of a day, each with the number of its logs."""
        text = "select machine, count(*) from parts where day = ? group by machine order by machine"
        return ((machine, count) for machine, count in self._base.execute(text, (day,)))

    # What days are merged of.

    def add_piece(self, counted: Counted, level: int) -> None:
        """Enters the summary of some logs of a machine's day that has many."""
        row = (counted.day, counted.machine, level, counted.summary)
        self._base.execute("insert into pieces values (?, ?, ?, ?)", row)

    def pieces(self, day: str, machine: str, level: int) -> Iterator[bytes]:
        """These summaries, of one level."""
        text = "select summary from pieces where (day, machine, level) = (?, ?, ?) order by rowid"
        return (summary for [summary] in self._base.execute(text, (day, machine, level)))

    def add_merged(self, counted: Counted) -> None:
        """Enters a machine's day that is merged."""
        row = (counted.day, counted.machine, counted.summary, json.dumps(counted.rows))
        self._base.execute("insert into merged values (?, ?, ?, ?)", row)

    def merged_rows(self, day: str) -> Iterator[dict[str, Any]]:
        """The rows of figures of a day, in the order of the machines."""
        text = "select rows from merged where day = ? order by machine"
        for [rows] in self._base.execute(text, (day,)):
            yield from json.loads(rows)

    def merged_summaries(self, day: str) -> Iterator[tuple[str, bytes]]:
        """Machines of a day with their packed summaries, in the order of the machines."""
        text = "select machine, summary from merged where day = ? order by machine"
        return ((machine, summary) for machine, summary in self._base.execute(text, (day,)))

    def end_day(self, day: str) -> None:
        """A day is written: what it was merged of is no longer needed."""
        for table in ("merged", "pieces"):
            self._base.execute(f"delete from {table} where day = ?", (day,))


LINE = tuple(field.name for field in dataclasses.fields(Line))
"""Columns of lines, in their order."""


def _row(log: Log) -> tuple[Any, ...]:
    return (log.url, log.machine, log.day, log.size, log.stamp, log.local)


def _log(row: Iterable[Any]) -> Log:
    url, machine, day, size, stamp, local = row
    return Log(url, machine, day, size, stamp, bool(local))


def _entry(row: tuple[Any, ...]) -> Entry:
    gone, blake3, settled, frames, first, last, incomplete, error, content = row[6:]
    first_ns, last_ns = (None if ns is None else int(ns) for ns in (first, last))
    read = Read(blake3, bool(settled), frames, first_ns, last_ns, None, incomplete, error, content)
    return Entry(_log(row[:6]), read, bool(gone))
