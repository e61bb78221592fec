"""Which logs there are, and of which machine and day each is: by pattern, or by a manifest.

In: a folder or an fsspec URL, and a pattern for the paths below it, or a table of paths. Out: a
`Log` for each file, and a `Stray` for each that belongs to no machine, one after the other in no
order. A folder of this machine is never listed as a whole.

Left out: what is in the logs, and their order (`scratch`).
"""

from __future__ import annotations

import datetime
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
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

AT_ONCE = 64
"""Rows of a manifest that are held in memory at once."""


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


@dataclass(frozen=True, slots=True)
class Stray:
    """A file of no machine, or one that should be a log and can't be read."""

    url: str
    sentence: str
    """Why."""
    should_be_log: bool = False


@dataclass(frozen=True, slots=True)
class About:
    """What a row of a manifest has on a machine."""

    machine: str
    values: dict[str, str]
    """By the names of `ABOUT`."""
    manifest: str


DAY = re.compile(r"(\d{4})([-_.]?)(\d{2})\2(\d{2})", re.ASCII)
"""A day in a name."""


def day_of(text: str) -> str | None:
    """A day as 2026-11-20, out of that or of 20261120; None for what is no day."""
    match = DAY.fullmatch(text)
    try:
        return match and datetime.date(int(match[1]), int(match[3]), int(match[4])).isoformat()
    except ValueError:
        return None


def _given_day(given: Any) -> str | None:
    """The day of a value in a table, which may be a date, a time or a text with either.

    Errors: `ValueError` where it is none.
    """
    text = str(given).strip()
    if given is None or not text:
        return None
    if (day := day_of(re.split(r"[T ]", text, maxsplit=1)[0])) is None:
        raise ValueError(f"{given!r} is no day such as 2026-11-20")
    return day


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


def find(
    logs: str | os.PathLike[str],
    pattern: str = PATTERN,
    out: str | os.PathLike[str] | None = None,
) -> Iterator[Log | Stray]:
    """The files below a folder or URL; those of the results in `out` are left aside.

    Errors: `FleetError` where the place can't be read, or, at the end, where there was no file, or
    none of the pattern.
    """
    name = os.fspath(logs)
    system, root = _open(name)
    wanted = matcher(pattern)
    is_any, strays = False, 0
    few: list[str] = []
    for path, info in _files(system, root, name, out):
        below = path[len(root.rstrip("/")) :].lstrip("/")
        if any(part.startswith(".") for part in below.split("/")):
            continue
        found = _judged(system, path, info, below, wanted.fullmatch(below), pattern)
        if isinstance(found, Stray):
            strays, few = strays + 1, sorted([*few, found.url])[:LISTED]
        else:
            is_any = True
        yield found
    if not is_any:
        raise _nothing(name, pattern, strays, few)


def _judged(
    system: Any,
    path: str,
    info: dict[str, Any],
    below: str,
    match: re.Match[str] | None,
    pattern: str,
) -> Log | Stray:
    """A file as a log, or as a stray."""
    day = match.groupdict().get("day") if match else None
    url = _url(system, path)
    if "error" in info:
        return Stray(shown(url), f"the folder can't be listed: {info['error']}", True)
    if unusable := _unusable(system, path):
        return Stray(shown(url), unusable, should_be_log=match is not None)
    if match is None:
        return Stray(url, f"{below} is not of the form {pattern}: no machine owns it")
    if day is not None and day_of(day) is None:
        return Stray(url, f"{day} in {below} is no day of the calendar", should_be_log=True)
    return _log(system, path, info, match["machine"], day and day_of(day))


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


def _nothing(logs: str, pattern: str, strays: int, few: list[str]) -> FleetError:
    """Why there is nothing to count; `few` are the first strays."""
    if not strays:
        return FleetError(f"{logs} holds no file: name the folder of the machines")
    return FleetError(
        f"none of {strays} files below {logs} is of the form {pattern}, such as {', '.join(few)}: "
        "give another --pattern"
    )


def read_manifest(
    manifest: str | os.PathLike[str], logs: str | os.PathLike[str]
) -> Iterator[Log | Stray | About]:
    """What a Parquet table lists; relative paths are below `logs`.

    It needs the columns path and machine, may have day, and those of `ABOUT` on the machine.
    Errors: `FleetError` where it can't be read, lacks a column, or lists nothing.
    """
    name = os.fspath(manifest)
    system, root = _open(os.fspath(logs))
    is_any = False
    for row in _rows(name):
        machine = row["machine"]
        if not row["path"] or not machine:
            raise FleetError(f"{name} has a row without path or machine: fill it in")
        yield About(str(machine), _about(row, name), name)
        yield _entered(system, root, row)
        is_any = True
    if not is_any:
        raise FleetError(f"{name} lists no log: give one with a row for each")


def _rows(manifest: str) -> Iterator[dict[str, Any]]:
    """The rows of a manifest."""
    try:
        opened = fsspec.open(manifest, "rb") if "://" in manifest else open(manifest, "rb")
        with opened as file:
            table = pyarrow.parquet.ParquetFile(file)
            names = _wanted(table.schema_arrow.names, manifest)
            for batch in table.iter_batches(AT_ONCE, columns=names):
                yield from _in_text(pyarrow.Table.from_batches([batch]), manifest).to_pylist()
    except FleetError:
        raise
    except (OSError, ValueError, ImportError, pyarrow.ArrowException) as why:
        raise FleetError(f"{manifest} can't be read as Parquet: {first_line(why)}") from None


def _wanted(names: list[str], manifest: str) -> list[str]:
    """The columns of a manifest that are used.

    Errors: `FleetError` where one is missing.
    """
    missing = [name for name in NEEDED if name not in names]
    if missing:
        raise FleetError(
            f"{manifest} has no column {' and no column '.join(missing)}: a manifest needs "
            f"{' and '.join(NEEDED)}, and may have day, {', '.join(ABOUT)}"
        )
    return [name for name in (*NEEDED, "day", *ABOUT) if name in names]


def _in_text(table: pyarrow.Table, manifest: str) -> pyarrow.Table:
    """The same with bytes as the text that they are.

    Errors: `FleetError` where they are none.
    """
    for number, name in enumerate(table.column_names):
        try:
            column = table.column(number)
            if pyarrow.types.is_fixed_size_binary(column.type):
                column = column.cast(pyarrow.large_binary())
            if column.type in (pyarrow.binary(), pyarrow.large_binary()):
                column = column.cast(pyarrow.large_string())
                table = table.set_column(number, name, column)
            column.validate(full=True)
        except pyarrow.ArrowException:
            raise FleetError(
                f"{manifest} has a {name} that is not UTF-8: write it as text"
            ) from None
    return table


def _about(row: dict[str, Any], manifest: str) -> dict[str, str]:
    """What a row has on its machine; an empty text is no value."""
    found: dict[str, str] = {}
    for name in ABOUT:
        value = row.get(name)
        if value is None or not str(value).strip():
            continue
        try:
            found[name] = str(_ABOUT.get(name, str)(value))
        except ValueError as why:
            raise FleetError(f"{manifest}: {name} {why}") from None
    return found


def _check_sum(given: Any) -> str:
    """A check sum as the nodes have it, or a text with several.

    Errors: `ValueError` where it is neither.
    """
    if isinstance(given, int) and not isinstance(given, bool) and 0 <= given < 2**32:
        return f"{given:08X}"
    if isinstance(given, str):
        return given
    raise ValueError(f"{given!r} is no check sum: give a text such as '1A2B3C4D'")


def _hash(given: Any) -> str:
    """A hash in text.

    Errors: `ValueError` where it is another value.
    """
    if isinstance(given, str):
        return given
    raise ValueError(f"{given!r} is no hash: give it as text of 64 hexadecimal digits")


_ABOUT: dict[str, Callable[[Any], str | None]] = {
    "certificate_sha256": _hash,
    "certificate_crc32": _check_sum,
    "calibration_due": _given_day,
}
"""How a value is read that is no text of any kind."""


def _entered(system: Any, root: str, row: dict[str, Any]) -> Log | Stray:
    """The log of a row."""
    path, day = str(row["path"]), row.get("day")
    if "://" in path:
        try:
            system, path = _open(path)
        except FleetError as why:
            return Stray(shown(path), str(why), should_be_log=True)
    elif not path.startswith("/"):
        path = f"{root.rstrip('/')}/{path}"
    url = _url(system, path)
    try:
        named = _given_day(day)
    except ValueError as why:
        return Stray(url, f"the manifest's day {why}", True)
    try:
        info = system.info(path)
    except (OSError, ValueError) as why:
        reason = getattr(why, "strerror", None) or first_line(why)
        return Stray(shown(url), f"the manifest lists it, and it can't be read: {reason}", True)
    return _log(system, path, info, str(row["machine"]), named)


def _open(url: str) -> tuple[Any, str]:
    if "://" not in url:
        # "::" may be in a name here; fsspec takes it for a chain of URLs.
        system = fsspec.filesystem("file")
        return system, system._strip_protocol(url)
    if "::" in url:
        raise FleetError(f"{url} is a chain of URLs: unpack it, and name the folder")
    try:
        return fsspec.core.url_to_fs(url)
    except (ImportError, ValueError) as why:
        raise FleetError(f"{url} is of a kind that is not installed: {first_line(why)}") from None


def _files(
    system: Any, root: str, name: str, out: str | os.PathLike[str] | None
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Paths of all files below a folder, each with what the file system has of it."""
    try:
        if not system.exists(root):
            raise FleetError(f"{name} is not there: name the folder of the machines")
        if system.isfile(root):
            raise FleetError(f"{name} is a file: name the folder of the machines")
        if _is_local(system):
            skipped = None if out is None or not os.path.isdir(out) else _place(out)
            yield from _walked(system, root, skipped, ())
        else:
            # A bucket lists all names in a few requests, and a folder at a time in many.
            yield from system.find(root, detail=True).items()
    except OSError as why:
        raise FleetError(f"{name} can't be listed: {first_line(why)}") from None


Inode = tuple[int, int]
"""What a folder has under any name: device and number."""


def _place(folder: str | os.PathLike[str]) -> Inode:
    found = os.stat(folder)
    return found.st_dev, found.st_ino


def _walked(
    system: Any, folder: str, skipped: Inode | None, above: tuple[Inode, ...]
) -> Iterator[tuple[str, dict[str, Any]]]:
    """The same of this machine, name by name, through links; what is gone meanwhile is left out,
    and so is the folder `skipped`. A folder that can't be listed stands for itself, with the reason
    as its `error`."""
    try:
        own = _place(folder)
        if own == skipped:
            return
        if own in above:
            yield folder, {"error": "it is a link to a folder that it is in"}
            return
        names = os.scandir(folder)
    except FileNotFoundError:
        return
    except OSError as why:
        yield folder, {"error": why.strerror or first_line(why)}
        return
    with names:
        for name in names:
            try:
                info = system.info(name)
            except FileNotFoundError:
                continue
            if info["type"] == "directory" or (info.get("islink") and os.path.isdir(name)):
                yield from _walked(system, info["name"], skipped, (*above, own))
            else:
                yield info["name"], info


def _log(system: Any, path: str, info: dict[str, Any], machine: str, day: str | None) -> Log:
    local = _is_local(system)
    if local and info.get("islink"):
        # Those of the file, and not of the link to it.
        found = os.stat(path)
        info = info | {"size": found.st_size, "mtime": found.st_mtime}
    keys = ("ETag", "etag", "mtime", "LastModified", "last_modified", "updated", "created")
    stamp = next((str(info[key]) for key in keys if info.get(key)), "")
    return Log(_url(system, path), machine, day, int(info.get("size") or 0), stamp, local)


def _is_local(system: Any) -> bool:
    return isinstance(system, fsspec.implementations.local.LocalFileSystem)


def _url(system: Any, path: str) -> str:
    return path if _is_local(system) else system.unstrip_protocol(path)
