"""Logs of a bus: the rows that `plumb replay --export` writes, as Arrow record batches."""

from __future__ import annotations

import operator
import os
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Union

import pyarrow

from ._plumb import Decoder, Error, IncompleteWarning
from .single import Single

Path = Union[str, "os.PathLike[str]"]

NODES = 127
"""The greatest node-id (CiA 301, 7.2.1)."""


def paths(given: Path | Iterable[Path]) -> list[str]:
    """One path or several, as text.

    Errors: `Error` where one is something else. The lines of an open file would be taken for paths.
    """
    if isinstance(given, (str, os.PathLike)):
        return [_path(given)]
    if isinstance(given, (bytes, bytearray)) or not isinstance(given, Iterable):
        raise Error(f"{given!r} is no path: give one, or a list of them")
    if hasattr(given, "read"):
        raise Error("an open file was given in place of a path: give its name")
    return [_path(path) for path in given]


def _path(given: Path) -> str:
    path = _named(given)
    if path is None:
        raise Error(f"{given!r} is no path: give one, or a list of them")
    return path


def path_of(given: Path, name: str) -> str:
    """A path as text, where there is one.

    Errors: `Error` where it is something else.
    """
    path = _named(given)
    if not path or "\0" in path:
        raise Error(f"{name} is {given!r}: give the name of a file or folder, as text")
    return path


def _named(given: object) -> str | None:
    """What is a path, as text; None for what is none."""
    if not isinstance(given, (str, os.PathLike)):
        return None
    path = os.fspath(given)
    try:
        os.fsencode(path)
    except UnicodeEncodeError:
        return None
    return path if isinstance(path, str) else None


def logs_of(given: Path | Iterable[Path]) -> list[str]:
    """The same of logs.

    Errors: `Error` where there is none.
    """
    found = paths(given)
    if not found:
        raise Error("there is no log: give at least one")
    return found


@dataclass(frozen=True)
class Skipped:
    """Lines of one kind that gave no frame."""

    reason: str
    count: int
    file: str
    """The file of the first of them."""
    first_line: int
    """Its line, counted from 1."""


def node_ids(nodes: Iterable[int]) -> list[int]:
    """Node-ids of CANopen, as the native half takes them.

    Errors: `Error` where one is none.
    """
    if isinstance(nodes, (str, bytes, bytearray)) or not isinstance(nodes, Iterable):
        raise Error(f"{nodes!r} is no list of node-ids: write it as [1, 2]")
    return [_node_id(node) for node in nodes]


def _node_id(given: object) -> int:
    try:
        node = operator.index(given)  # type: ignore[arg-type]
    except TypeError:
        raise Error(f"{given!r} is no node-id: give a whole number of 1 to {NODES}") from None
    if not 1 <= node <= NODES:
        raise Error(f"{node} is no node-id: give 1 to {NODES}")
    return node


class Decoded(Single):
    """A log under way: an iterable of record batches, and an Arrow stream.

    It can be read once, though its schema more often. `pyarrow.table`, `polars.DataFrame`, pandas'
    `DataFrame.from_arrow` and queries of DuckDB take it as it is, since it has
    `__arrow_c_stream__`; memory does not grow with the log as long as the batches are let go. What
    could not be read is counted in `skipped` and `damaged`, and at the end of an iteration there is
    an `IncompleteWarning` about it.
    """

    def __init__(self, decoder: Decoder) -> None:
        self._decoder = decoder

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return self._decoder.__arrow_c_stream__(requested_schema)

    def __iter__(self) -> Iterator[pyarrow.RecordBatch]:
        reader = pyarrow.RecordBatchReader.from_stream(self._decoder)
        while (batch := self._next(reader)) is not None:
            yield batch
        self._warn()

    def _next(self, reader: pyarrow.RecordBatchReader) -> pyarrow.RecordBatch | None:
        try:
            return reader.read_next_batch()
        except StopIteration:
            return None
        except (pyarrow.ArrowException, OSError):
            if self._decoder.failure is None:
                raise
            raise Error(self._decoder.failure) from None

    def read_all(self) -> pyarrow.Table:
        """All rows in one table, in memory."""
        reader = pyarrow.RecordBatchReader.from_stream(self._decoder)
        batches = []
        while (batch := self._next(reader)) is not None:
            batches.append(batch)
        self._warn()
        return pyarrow.Table.from_batches(batches, reader.schema)

    def _warn(self) -> None:
        if self._decoder.incomplete is not None:
            warnings.warn(self._decoder.incomplete, IncompleteWarning, stacklevel=3)

    @property
    def frames(self) -> int:
        """Frames read so far."""
        return self._decoder.frames

    @property
    def files(self) -> list[str]:
        """The logs that were found."""
        return self._decoder.files

    @property
    def skipped(self) -> list[Skipped]:
        """Lines that gave no frame so far, by reason."""
        return [Skipped(*kind) for kind in self._decoder.skipped]

    @property
    def damaged(self) -> list[str]:
        """Compressed files whose end is missing or damaged, and how."""
        return self._decoder.damaged

    @property
    def not_logs(self) -> list[str]:
        """Files of a folder that are no logs."""
        return self._decoder.not_logs

    @property
    def incomplete(self) -> str | None:
        """At the end, a sentence on what could not be read; None when nothing is missing."""
        return self._decoder.incomplete


def decode(
    log: Path | Iterable[Path],
    eds: Path | Iterable[Path] | None = None,
    *,
    nodes: Iterable[int] = (),
    channel: str | None = None,
    begin: str | float | None = None,
    end: str | float | None = None,
) -> Decoded:
    """Decodes logs: files or folders of candump or ASC, plain or gzip.

    `eds` are data sheets, each with `@NODE` behind it where it has no node-id. `nodes` are node-ids
    A, B, A, B; 1 and 2 by default. `channel` names one interface. `begin` and `end` are seconds
    since the first frame, or a date as 2026-11-22T12:30:00.
    """
    sheets = [] if eds is None else paths(eds)
    if not (channel is None or isinstance(channel, str)):
        raise Error(f"channel is {channel!r}: give the name of an interface, such as 'can0'")
    part = _moment(begin, "begin"), _moment(end, "end")
    return Decoded(Decoder(logs_of(log), sheets, node_ids(nodes), channel, *part))


def _moment(given: str | float | None, name: str) -> str | None:
    """Where a log begins or ends, in the words of the command line."""
    if given is None or isinstance(given, str):
        return given
    try:
        return repr(float(given))
    except (TypeError, ValueError):
        raise Error(
            f"{name} is {given!r}: give seconds, or a date as '2026-11-22T12:30:00'"
        ) from None
