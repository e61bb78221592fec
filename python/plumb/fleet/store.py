"""What is kept in the folder of a fleet, each file complete or not there.

    logs/KEY/ab/BLAKE3         summary of a log, or why there is none, by the log's content
    logs.parquet               every log: machine, day, content, status and sentence; and a copy
    figures/D/rows.parquet     a row per machine and instrument of the day D
    summaries/D/rows.parquet   the merged summary of each machine
    machines.parquet           what manifests have on the machines
    machines/NAME/             the period page of a machine
    report.html, report.json   the page

In: results. Out: files, each written under another name in the same folder and renamed when it is
complete. One run at a time owns the folder.

Left out: what is in them (`work`, `figures`, `page`).
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import json
import os
import pathlib
import re
import shutil
import tempfile
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import IO, Any

import pyarrow
import pyarrow.parquet

from .errors import FleetError, first_line
from .layout import ABOUT, Log, day_of, shown
from .work import Read, unpack

LEDGER = pyarrow.schema(
    [
        ("log", pyarrow.string()),
        ("machine", pyarrow.string()),
        ("day", pyarrow.string()),
        ("status", pyarrow.string()),
        ("sentence", pyarrow.string()),
        ("frames", pyarrow.int64()),
        ("size", pyarrow.int64()),
        ("blake3", pyarrow.string()),
        ("stamp", pyarrow.string()),
        ("path_day", pyarrow.string()),
        ("key", pyarrow.string()),
    ]
)
"""Columns of logs.parquet."""


@dataclass(frozen=True, slots=True)
class Line:
    """A row of logs.parquet."""

    log: str
    key: str
    """How it was read."""
    status: str = ""
    """counted, incomplete, duplicate, failed or stray."""
    sentence: str | None = None
    machine: str | None = None
    day: str | None = None
    """That it counts on."""
    frames: int | None = None
    size: int | None = None
    blake3: str | None = None
    stamp: str | None = None
    """That of the file, where it stands for its content."""
    path_day: str | None = None


MACHINES = pyarrow.schema([(name, pyarrow.string()) for name in ("machine", *ABOUT)])
"""Columns of machines.parquet."""

SUMMARIES = pyarrow.schema(
    [(name, pyarrow.string()) for name in ("machine", "day")] + [("summary", pyarrow.binary())]
)
"""Columns of the summaries."""

JOURNAL = ".journal"

LEDGER_COPY = ".logs.parquet"
"""The same as logs.parquet, which can't be made anew for logs that are gone."""

MARKS = (".lock", JOURNAL, "logs.parquet", LEDGER_COPY)
"""A folder with one of these is that of a fleet."""

FILES = (*MARKS, "machines.parquet", "report.html", "report.json")
"""Files of the folder."""

REPORTS = ("report.html", "report.json")
"""Files of a machine's folder."""

TABLE = "rows.parquet"
"""The file of a day's folder."""

KINDS = ("figures", "summaries")
"""Folders of a folder for each day."""

PART = ".part"
"""What the name of a file ends with until it is complete; it begins with a dot."""

NAME = 40
"""Letters of a file's name that are in it until then."""

FORMER_PART = re.compile(r"\.[a-z0-9_]{8}")
"""The same of earlier versions."""

FORMERLY = "day="
"""What the folder of a day began with in earlier versions. Readers of Parquet take that for a
column of its own, which is not that of the tables."""

FOLDERS = ("logs", *KINDS, "machines")
"""Folders in it."""

FORMAT = "2"
"""Version of the tables. A folder of another one is refused."""

AT_ONCE = 1024
"""Rows of a table that are held in memory at once."""

AS_ROWS = 64
"""Of these, rows that are held as dictionaries."""

VERSION = 2
"""Version of what is kept of a log: that of the summaries. Another one is counted anew."""


BEGIN = b'{"format":"plumb-summary","version":%d,' % VERSION
"""What a summary begins with."""


class Damaged(FleetError):
    """The summary of a log can't be used; the text states which."""


class Store:
    """The folder of a fleet."""

    def __init__(self, folder: pathlib.Path, key: str) -> None:
        self.folder = folder
        self._logs = folder / "logs" / key

    # Summaries of logs, by content.

    def _place(self, blake3: str, key: str | None = None) -> pathlib.Path:
        logs = self._logs if key is None else self._logs.with_name(key)
        return logs / blake3[:2] / blake3

    def put(self, result: Read) -> Read:
        """Keeps what a log has come to, once for all logs of the same content; the same with what
        is known of its file from another log."""
        if result.blake3 is None:
            return result
        if result.content is None and (before := self.get(result.blake3)):
            result = dataclasses.replace(result, content=before.content)
        head = {
            "version": VERSION,
            "frames": result.frames,
            "first_ns": result.first_ns,
            "last_ns": result.last_ns,
            "incomplete": result.incomplete,
            "error": result.error,
            "content": result.content,
        }
        head["crc32"] = _check_sum(head)
        body = json.dumps(head).encode() + b"\n" + (result.summary or b"")
        write(self._place(result.blake3), body)
        return result

    def put_content(self, blake3: str, content: str) -> None:
        """Keeps what is in a log whose file has this hash; nothing where its summary is damaged."""
        place, read = self._place(blake3), self.get(blake3)
        with contextlib.suppress(OSError):
            summary = place.read_bytes().partition(b"\n")[2]
            if read is not None:
                self.put(dataclasses.replace(read, summary=summary, content=content))

    def get(self, blake3: str | None, key: str | None = None) -> Read | None:
        """What a log of this content has come to, without the summary; None where that is not kept,
        damaged, or of another version. `key` stands for another reading."""
        if blake3 is None:
            return None
        try:
            with self._place(blake3, key).open("rb") as file:
                fields = json.loads(file.readline())
            # Earlier versions have written none.
            if fields.pop("crc32", None) not in (None, _check_sum(fields)):
                return None
            version = fields.pop("version")
            fits = all(one is None or isinstance(one, HEAD[name]) for name, one in fields.items())
            is_it = version == VERSION and fits and 0 <= fields["frames"] < 2**63
            return Read(blake3, True, **fields) if is_it else None
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
            return None

    def summary(self, blake3: str) -> bytes:
        """The packed summary of a log.

        Errors: `Damaged` where it can't be used; it is removed then.
        """
        place = self._place(blake3)
        try:
            packed = place.read_bytes().partition(b"\n")[2]
            is_whole = unpack(packed).startswith(BEGIN)
        except (OSError, zlib.error):
            is_whole = False
        if not is_whole:
            with _in_words(place):
                place.unlink(missing_ok=True)
            raise Damaged(f"{place} was damaged and is removed: run again") from None
        return packed

    # Tables.

    def ledger(self) -> Iterator[Line]:
        """The lines of the last run; none where there was no run."""
        path, copy = self.folder / "logs.parquet", self.folder / LEDGER_COPY
        if copy.is_file() and not _is_whole(path) and _is_whole(copy):
            path = copy
        return (Line(**row) for row in _rows(path))

    def note(self, log: Log, result: Read, key: str) -> None:
        """Keeps in a journal which content a log has, so that an interrupted run is gone on with."""
        if not result.settled or result.blake3 is None:
            return
        line = {"log": log.url, "stamp": log.stamp, "size": log.size, "key": key}
        line["blake3"] = result.blake3
        with (self.folder / JOURNAL).open("a", encoding="utf-8", errors="surrogateescape") as file:
            file.write(json.dumps(line) + "\n")

    def journal(self) -> Iterator[Line]:
        """The logs of a run that was interrupted; a line that was cut is left out."""
        path = self.folder / JOURNAL
        if not path.exists():
            return
        with path.open(encoding="utf-8", errors="replace") as file:
            for text in file:
                with contextlib.suppress(ValueError, TypeError, AttributeError):
                    fields = json.loads(text)
                    if all(_is_plain(value) for value in fields.values()):
                        yield Line(**fields)

    def end_journal(self) -> None:
        """The lines of the run are written: the journal has ended."""
        (self.folder / JOURNAL).unlink(missing_ok=True)

    def write_ledger(self, lines: Iterable[Line]) -> None:
        """Writes the lines, which are in the order of the logs."""
        rows = ({name: getattr(line, name) for name in LEDGER.names} for line in lines)
        path = self.folder / "logs.parquet"
        write_table(path, rows, LEDGER)
        with _in_words(path), path.open("rb") as whole:
            with _replacing(self.folder / LEDGER_COPY) as copy:
                shutil.copyfileobj(whole, copy)

    def machines(self) -> Iterator[dict[str, Any]]:
        """What is known of the machines from manifests, a row for each."""
        return _rows(self.folder / "machines.parquet")

    def write_machines(self, machines: Iterable[dict[str, Any]]) -> None:
        """Writes what is known of the machines, which are in their order."""
        write_table(self.folder / "machines.parquet", machines, MACHINES)

    def partition(self, kind: str, day: str) -> pathlib.Path:
        """The file of a day, of `figures` or `summaries`."""
        return self.folder / kind / day / TABLE

    def days(self) -> list[str]:
        """The days that are there, as a whole or in part."""
        return sorted({day for kind in KINDS for day in days_of(self.folder / kind)})

    def digest(self, day: str) -> str | None:
        """What a day was made of; None where it is not there as a whole."""
        digests = set()
        for kind in ("figures", "summaries"):
            try:
                metadata = pyarrow.parquet.read_metadata(self.partition(kind, day)).metadata
            except (OSError, pyarrow.ArrowException):
                return None
            digests.add((metadata or {}).get(b"plumb-inputs", b"").decode())
        return digests.pop() if len(digests) == 1 else None

    def drop_day(self, day: str) -> None:
        """Removes a day that has no log any more."""
        for kind in KINDS:
            remove_made(self.partition(kind, day).parent, (TABLE,))

    def drop_damaged(self) -> bool:
        """Removes days with a table that can't be read; whether there was one."""
        damaged = [day for day in self.days() if not self._is_readable(day)]
        for day in damaged:
            self.drop_day(day)
        return bool(damaged)

    def _is_readable(self, day: str) -> bool:
        return all(_is_whole(self.partition(kind, day)) for kind in KINDS)

    def summaries(self, machine: str) -> Iterator[bytes]:
        """The summaries of a machine's days, in the order of the days."""
        for day in self.days():
            table = pyarrow.parquet.read_table(
                self.partition("summaries", day), filters=[("machine", "=", machine)]
            )
            yield from table.column("summary").to_pylist()


HEAD: dict[str, type] = dict.fromkeys(("frames", "first_ns", "last_ns"), int)
HEAD |= dict.fromkeys(("incomplete", "error", "content"), str)
"""Types of what is kept of a log."""


def _is_plain(value: object) -> bool:
    """Whether a table can hold a value of the journal."""
    if isinstance(value, str):
        return shown(value) == value
    return isinstance(value, int) and abs(value) < 2**63


def _check_sum(fields: dict[str, Any]) -> int:
    """The check sum of what is kept of a log, beside its summary, which has one of its own."""
    return zlib.crc32(json.dumps(fields).encode())


def days_of(folder: pathlib.Path) -> dict[str, pathlib.Path]:
    """The days of a folder of figures or summaries in their order, each with its own folder, also
    one that an earlier version has made."""
    return dict(sorted((day, own) for day, own in _places(folder) if (own / TABLE).exists()))


def _places(folder: pathlib.Path) -> list[tuple[str, pathlib.Path]]:
    """Days with their folders, that of an earlier version first where a day has both. A link is
    none: what is behind it is not of this folder."""
    former = [(path.name.removeprefix(FORMERLY), path) for path in folder.glob(f"{FORMERLY}*")]
    days = former + [(path.name, path) for path in folder.glob("*")]
    return [(day, path) for day, path in days if day_of(day) == day and not path.is_symlink()]


def remove_made(folder: pathlib.Path, names: Iterable[str]) -> None:
    """Removes files of these names, and their folder where nothing else is in it. What is behind a
    link stays."""
    if folder.is_symlink() or not folder.is_dir():
        return
    with contextlib.suppress(OSError):
        for name in names:
            (folder / name).unlink(missing_ok=True)
        folder.rmdir()


def rename_former_days(folder: pathlib.Path) -> None:
    """Gives the folders that an earlier version has made the names of this one.

    Errors: `FleetError` where that is refused.
    """
    for kind in KINDS:
        for day, former in _places(folder / kind):
            place = former.with_name(day)
            if place == former or not (former / TABLE).is_file():
                continue
            try:
                place.mkdir(exist_ok=True)
                if not (place / TABLE).exists():
                    (former / TABLE).rename(place / TABLE)
                remove_made(former, (TABLE,))
            except OSError as why:
                reason = why.strerror or why
                raise FleetError(f"cannot rename {former}: {reason}; remove it") from None


def refuse_others(folder: pathlib.Path) -> None:
    """Refuses a folder that is not empty and has no mark of a fleet, and one in which a folder
    stands where a file has its place, or a file for a folder.

    Errors: `FleetError`; nothing was changed.
    """
    if folder.is_dir() and not any((folder / mark).exists() for mark in MARKS):
        try:
            first = min(os.listdir(folder), default=None)
        except OSError as why:
            raise FleetError(f"{folder} can't be listed: {why.strerror or why}") from None
        if first is not None:
            raise FleetError(
                f"{folder} has {first} in it and no results of a fleet: name an empty folder, or a "
                "new one"
            )
    days = [place for kind in KINDS for _, place in _places(folder / kind)]
    files = [folder / name for name in FILES] + [day / TABLE for day in days]
    folders = [folder / name for name in FOLDERS] + days
    folders += (folder / "logs").glob("*")
    for path in files:
        if path.is_dir():
            raise FleetError(f"{path} is a folder, and a file has its place there: move it away")
    for path in folders:
        if path.exists() and not path.is_dir():
            raise FleetError(f"{path} is a file, and a folder has its place there: move it away")


def _rows(path: pathlib.Path) -> Iterator[dict[str, Any]]:
    """The rows of a table, some of them in memory at once; none where it is not there.

    Errors: `FleetError` where it is damaged, or of another version of this package.
    """
    with _in_words(path):
        if not path.exists():
            return
    refuse_other_format(path)
    try:
        with pyarrow.parquet.ParquetFile(path) as table:
            for batch in table.iter_batches(AS_ROWS):
                yield from batch.to_pylist()
    except (OSError, pyarrow.ArrowException) as why:
        raise _unreadable(path, why) from None


def refuse_other_format(path: pathlib.Path) -> None:
    """Refuses a table that is damaged, or of another version of this package.

    Errors: `FleetError`.
    """
    try:
        metadata = pyarrow.parquet.read_metadata(path).metadata or {}
    except (OSError, pyarrow.ArrowException) as why:
        raise _unreadable(path, why) from None
    found = metadata.get(b"plumb-format", b"none").decode(errors="replace")
    if found != FORMAT:
        raise FleetError(
            f"{path} is of format {found}, and format {FORMAT} is read: count the logs into a new "
            "folder"
        )


def _is_whole(path: pathlib.Path) -> bool:
    """Whether a table can be read to its end."""
    try:
        with pyarrow.parquet.ParquetFile(path) as table:
            for _ in table.iter_batches(AS_ROWS):
                pass
    except (OSError, pyarrow.ArrowException):
        return False
    return True


LOST = {
    "logs.parquet": "logs that are gone no longer count then, and the others are counted anew",
    "machines.parquet": "what manifests had on the machines is lost then",
}
"""What is lost with a table."""


def _unreadable(path: pathlib.Path, why: BaseException) -> FleetError:
    if isinstance(why, OSError) and why.errno is not None:
        return FleetError(f"{path} can't be read: {os.strerror(why.errno)}; allow it, and run again")
    lost = LOST.get(path.name.lstrip("."), "it is made anew then")
    return FleetError(
        f"{path} is damaged ({first_line(why)}): put a copy of it back, or remove it; {lost}"
    )


@contextlib.contextmanager
def _in_words(path: pathlib.Path) -> Iterator[None]:
    """A file that can't be read as `FleetError`."""
    try:
        yield
    except OSError as why:
        raise _unreadable(path, why) from None


def write_table(
    path: pathlib.Path,
    rows: Iterable[dict[str, Any]],
    schema: pyarrow.Schema,
    inputs: str = "",
    at_once: int = AT_ONCE,
) -> None:
    """Writes rows as Parquet; `inputs` stands in the metadata for what they were made of.

    `at_once` rows make a row group, and are held in memory in columns.
    """
    schema = schema.with_metadata({"plumb-format": FORMAT, "plumb-inputs": inputs})
    left = iter(rows)
    with _replacing(path) as file:
        with pyarrow.parquet.ParquetWriter(file, schema, compression="zstd") as table:
            while group := list(_batches(itertools.islice(left, at_once), schema)):
                table.write_table(pyarrow.Table.from_batches(group, schema))


def _batches(
    rows: Iterator[dict[str, Any]], schema: pyarrow.Schema
) -> Iterator[pyarrow.RecordBatch]:
    """Rows in columns; a row as a dictionary takes ten times the room."""
    while some := list(itertools.islice(rows, AS_ROWS)):
        yield pyarrow.RecordBatch.from_pylist(some, schema=schema)


def write(path: pathlib.Path, content: bytes) -> None:
    """Writes a file.

    Errors: `FleetError` where there is no room or no right.
    """
    with _replacing(path) as file:
        file.write(content)


@contextlib.contextmanager
def _replacing(path: pathlib.Path) -> Iterator[IO[bytes]]:
    """A file to write to: it has another name beside `path`, and is renamed when it is complete.

    Errors: `FleetError` where there is no room or no right.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # As long as a name may be, and as reports are written.
        words = {"prefix": f".{path.name[:NAME]}.", "suffix": PART}
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False, **words) as file:
            try:
                yield file
                file.close()
                os.chmod(file.name, 0o644)
                os.replace(file.name, path)
            except BaseException:
                os.unlink(file.name)
                raise
    except OSError as why:
        raise FleetError(
            f"cannot write {path}: {why.strerror or why}; make room or choose another folder"
        ) from None


@contextlib.contextmanager
def owned(folder: pathlib.Path) -> Iterator[None]:
    """The folder for one run alone; it is made where it is not there, and what a killed run was
    writing is removed.

    Errors: `FleetError` where another run has it, or it can't be made.
    """
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = open(folder / ".lock", "a")
    except OSError as why:
        raise FleetError(
            f"cannot make the folder {folder}: {why.strerror or why}; choose another one"
        ) from None
    with file:
        if not _lock(file) or os.fstat(file.fileno()).st_nlink == 0:
            raise FleetError(f"another run writes to {folder}: wait for it, or choose another one")
        try:
            _remove_parts(folder)
            yield
        finally:
            _tidy_up(folder, made)


def _remove_parts(folder: pathlib.Path) -> None:
    """Removes what a run that was killed has left of files that it was writing."""
    days = (day for kind in KINDS for _, day in _places(folder / kind))
    own = [*days, *(folder / "logs").glob("*/*")]
    # In these a person may have hidden files, too.
    shared = [folder, *(folder / "machines").glob("*")]
    left = [file for place in own + shared for file in place.glob(f".*{PART}")]
    left += [
        file for place in own for file in place.glob(".*") if FORMER_PART.fullmatch(file.name)
    ]
    for file in left:
        with contextlib.suppress(OSError):
            file.unlink()


def _tidy_up(folder: pathlib.Path, made: bool) -> None:
    """Leaves nothing behind where the folder was made and nothing was written."""
    if made and os.listdir(folder) == [".lock"]:
        with contextlib.suppress(OSError):
            (folder / ".lock").unlink()
            folder.rmdir()


def _lock(file: Any) -> bool:
    try:
        import fcntl
    except ImportError:
        import msvcrt

        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        except OSError:
            return False
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
