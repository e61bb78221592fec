"""Which logs there are, and of which machine and day each is: by pattern, or by a manifest.

In: a folder or an fsspec URL, and a pattern for the paths below it, or a table of paths. Out: a
`Log` for each file, and the files that belong to no machine, with a sentence.

Left out: what is in the logs.
"""

from __future__ import annotations

import datetime
import os
import re
import sys
from dataclasses import dataclass, field
from typing import Any

import fsspec
import pyarrow
import pyarrow.parquet

from .errors import FleetError, first_line

PATTERN = "{machine}/{day}*"
"""The default: a folder for each machine, in it files or folders whose names begin with the day."""

NEEDED = ("path", "machine")
"""Columns that a manifest must have."""

ABOUT = ("model", "firmware", "certificate_sha256", "certificate_crc32", "calibration_due")
"""Columns of a manifest on the machine; the last is a day."""

LISTED = 3
"""Names that a sentence has room for."""


@dataclass(frozen=True, slots=True)
class Log:
    """A file that should be a log."""

    url: str
    """Where it is; what it is called in all lists."""
    machine: str
    day: str | None
    """The day in its path or in the manifest, such as 2026-11-20; None without one."""
    size: int
    """Bytes."""
    stamp: str
    """Changes when the file is written; empty where that can't be relied on."""
    local: bool

    @property
    def name(self) -> str:
        """Its name without folders."""
        return self.url.rstrip("/").rsplit("/", 1)[-1]


@dataclass
class Found:
    """All that was found."""

    logs: list[Log] = field(default_factory=list)
    strays: dict[str, str] = field(default_factory=dict)
    """Files of no machine, each with a sentence."""
    notes: dict[str, str] = field(default_factory=dict)
    """Logs of which something is to be said although they count."""
    machines: dict[str, dict[str, Any]] = field(default_factory=dict)
    """What a manifest has on each machine."""


def day_of(text: str) -> str | None:
    """A day as 2026-11-20, out of that or of 20261120; None for what is no day."""
    digits = re.sub(r"[-_.]", "", text)
    try:
        return datetime.datetime.strptime(digits, "%Y%m%d").date().isoformat()
    except ValueError:
        return None


def matcher(pattern: str) -> re.Pattern[str]:
    """The expression of a pattern with `{machine}`, `{day}`, `*` and `**`."""
    if "{machine}" not in pattern:
        raise FleetError(f"the pattern {pattern!r} has no {{machine}}: write it as {PATTERN!r}")
    parts = {
        "{machine}": r"(?P<machine>[^/]+?)",
        "{day}": r"(?P<day>\d{4}[-_.]?\d{2}[-_.]?\d{2})",
        "**": r".*",
        "*": r"[^/]*",
    }
    split = re.split(r"(\{machine\}|\{day\}|\*\*|\*)", pattern.strip("/"))
    for name in ("{machine}", "{day}"):
        if split.count(name) > 1:
            raise FleetError(f"the pattern {pattern!r} has {name} twice: name it once")
    text = "".join(parts.get(part) or re.escape(part) for part in split)
    return re.compile(f"{text}(/.*)?", re.DOTALL)


def find(logs: str | os.PathLike[str], pattern: str = PATTERN) -> Found:
    """The logs below a folder or URL, in the order of their URLs.

    Errors: `FleetError` where the place can't be read, holds no file, or no file matches.
    """
    system, root = _open(os.fspath(logs))
    wanted = matcher(pattern)
    found = Found()
    for path, info in sorted(_files(system, root, os.fspath(logs)).items()):
        below = path[len(root.rstrip("/")) :].lstrip("/")
        if any(part.startswith(".") for part in below.split("/")):
            continue
        match = wanted.fullmatch(below)
        day = match.groupdict().get("day") if match else None
        url = _url(system, path)
        if unusable := _unusable(system, path):
            found.strays[shown(url)] = unusable
        elif match is None:
            found.strays[url] = f"{below} is not of the form {pattern}: no machine owns it"
        elif day is not None and day_of(day) is None:
            found.strays[url] = f"{day} in {below} is no day of the calendar"
        else:
            machine = match["machine"]
            found.logs.append(_log(system, path, info, machine, day and day_of(day)))
    _refuse_nothing(found, os.fspath(logs), pattern)
    return found


def _unusable(system: Any, path: str) -> str | None:
    """Why a file can be no log whatever is in it: pipes and links to nowhere, and names that no
    table can hold."""
    if shown(path) != path:
        return "its name is not UTF-8: rename it"
    if _is_local(system) and not os.path.isfile(path):
        return "is no file: it is a link to nowhere, a pipe or a device"
    return None


def shown(name: str) -> str:
    """A name with what is no UTF-8 in it as escapes."""
    return name.encode("utf-8", "backslashreplace").decode()


def _refuse_nothing(found: Found, logs: str, pattern: str) -> None:
    if found.logs:
        return
    if not found.strays:
        raise FleetError(f"{logs} holds no file: name the folder of the machines")
    few = ", ".join(sorted(found.strays)[:LISTED])
    raise FleetError(
        f"none of {len(found.strays)} files below {logs} is of the form {pattern}, such as {few}: "
        "give another --pattern"
    )


def read_manifest(manifest: str | os.PathLike[str], logs: str | os.PathLike[str]) -> Found:
    """The logs that a Parquet table lists; relative paths are below `logs`.

    It needs the columns path and machine, may have day, and those of `ABOUT` on the machine.
    Errors: `FleetError` where it can't be read, lacks a column, or a machine has two values.
    """
    table = _table(os.fspath(manifest))
    found = Found()
    system, root = _open(os.fspath(logs))
    for row in table.to_pylist():
        machine = row["machine"]
        if not row["path"] or not machine:
            raise FleetError(f"{manifest} has a row without path or machine: fill it in")
        _tell_about(found, str(machine), row, os.fspath(manifest))
        _enter(found, system, root, row)
    _once(found)
    if not found.logs and not found.strays:
        raise FleetError(f"{manifest} lists no log: give one with a row for each")
    return found


def _once(found: Found) -> None:
    """Each log once, in the order of their URLs; of rows of the same path the first one counts."""
    logs: dict[str, Log] = {}
    for log in found.logs:
        first = logs.setdefault(log.url, log)
        if first is not log:
            whose = "" if log.machine == first.machine else f", for {first.machine}"
            found.notes.setdefault(log.url, f"the manifest lists it twice: counted once{whose}")
    found.logs = sorted(logs.values(), key=lambda log: log.url)


def _table(manifest: str) -> pyarrow.Table:
    try:
        with fsspec.open(manifest, "rb") as file:
            table = pyarrow.parquet.read_table(file)
    except (OSError, ValueError, ImportError, pyarrow.ArrowException) as why:
        raise FleetError(f"{manifest} can't be read as Parquet: {first_line(why)}") from None
    missing = [name for name in NEEDED if name not in table.column_names]
    if missing:
        raise FleetError(
            f"{manifest} has no column {' and no column '.join(missing)}: a manifest needs "
            f"{' and '.join(NEEDED)}, and may have day, {', '.join(ABOUT)}"
        )
    return _in_text(table, manifest)


def _in_text(table: pyarrow.Table, manifest: str) -> pyarrow.Table:
    """The same with bytes as the text that they are.

    Errors: `FleetError` where they are none.
    """
    for number, name in enumerate(table.column_names):
        if name not in (*NEEDED, "day", *ABOUT):
            continue
        try:
            column = table.column(number)
            if column.type in (pyarrow.binary(), pyarrow.large_binary()):
                column = column.cast(pyarrow.large_string())
                table = table.set_column(number, name, column)
            column.validate(full=True)
        except pyarrow.ArrowException:
            raise FleetError(
                f"{manifest} has a {name} that is not UTF-8: write it as text"
            ) from None
    return table


def _tell_about(found: Found, machine: str, row: dict[str, Any], manifest: str) -> None:
    about = found.machines.setdefault(machine, {})
    for name in ABOUT:
        value = row.get(name)
        if value is None:
            continue
        if name == "calibration_due":
            value = _due(value, manifest)
        if about.setdefault(name, str(value)) != str(value):
            raise FleetError(f"{manifest} has two values of {name} for {machine}: keep one")


def _due(value: Any, manifest: str) -> str:
    text = value.isoformat()[:10] if hasattr(value, "isoformat") else day_of(str(value))
    if text is None:
        raise FleetError(f"{manifest}: calibration_due {value!r} is no day such as 2026-11-20")
    return text


def _enter(found: Found, system: Any, root: str, row: dict[str, Any]) -> None:
    path, day = str(row["path"]), row.get("day")
    if "://" in path:
        system, path = _open(path)
    elif not path.startswith("/"):
        path = f"{root.rstrip('/')}/{path}"
    url = _url(system, path)
    named = None if day is None else day_of(str(day)[:10])
    if day is not None and named is None:
        found.strays[url] = f"the manifest's day {day!r} is no day such as 2026-11-20"
        return
    try:
        info = system.info(path)
    except (OSError, ValueError) as why:
        found.strays[url] = f"the manifest lists it, and it can't be read: {first_line(why)}"
        return
    found.logs.append(_log(system, path, info, str(row["machine"]), named))


def _open(url: str) -> tuple[Any, str]:
    try:
        return fsspec.core.url_to_fs(url)
    except (ImportError, ValueError) as why:
        raise FleetError(f"{url} is of a kind that is not installed: {first_line(why)}") from None


def _files(system: Any, root: str, name: str) -> dict[str, dict[str, Any]]:
    try:
        if not system.exists(root):
            raise FleetError(f"{name} is not there: name the folder of the machines")
        if system.isfile(root):
            raise FleetError(f"{name} is a file: name the folder of the machines")
        return system.find(root, detail=True)
    except OSError as why:
        raise FleetError(f"{name} can't be listed: {first_line(why)}") from None


def _log(system: Any, path: str, info: dict[str, Any], machine: str, day: str | None) -> Log:
    local = _is_local(system)
    keys = ("ETag", "etag", "mtime", "LastModified", "last_modified", "updated", "created")
    stamp = next((str(info[key]) for key in keys if info.get(key)), "")
    size = int(info.get("size") or 0)
    # Many logs share a machine or a day: each name is held once.
    day = None if day is None else sys.intern(day)
    return Log(_url(system, path), sys.intern(machine), day, size, stamp, local)


def _is_local(system: Any) -> bool:
    return isinstance(system, fsspec.implementations.local.LocalFileSystem)


def _url(system: Any, path: str) -> str:
    return path if _is_local(system) else system.unstrip_protocol(path)
