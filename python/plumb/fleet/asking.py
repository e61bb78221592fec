"""Questions to the figures of a fleet: SQL on DuckDB, over the Parquet in its folder.

In: the folder, and the name of a question in `queries/` or SQL of one's own. Out: a table. The
tables are `figures`, `machines` and `logs`, and the view `machine_days`; docs/fleet.md lists their
columns.
"""

from __future__ import annotations

import contextlib
import datetime
import importlib.resources
import os
import pathlib
import re
import tempfile
from collections.abc import Iterator
from typing import Any

import pyarrow

from .._plumb import Error
from ..logs import path_of
from .errors import FleetError, first_line
from .layout import day_of
from .store import LEDGER, MACHINES, days_of, refuse_other_format

QUESTIONS = ("faults", "drift", "histories", "calibration", "restarts", "silent", "standing")
"""The questions that have a file in `queries/`."""


DEFAULTS = {"recent_days": 7, "least_days": 5, "band_deg": None}
"""Parameters of the questions where none are given; `today` is the last day with data."""

LEAN_MB = 64
"""Memory that DuckDB has for the questions of a page, MB; what is more it keeps in files."""

NEWEST = """select coalesce((select max(day) from logs where status in ('counted', 'incomplete')
    and (path_day is null or path_day = day) and day in (select day from figures)), max(day))
    from figures"""

AT_ONCE = 256
"""Rows of an answer that are held in memory at once."""


def sql(name: str) -> str:
    """The text of a question, or of the views."""
    return importlib.resources.files(__package__).joinpath(f"queries/{name}.sql").read_text()


class Figures:
    """The figures in a folder, opened for questions; close it, or use it in a `with`.

    With `lean` they are asked in one thread and little memory, however many there are, and sums are
    formed in one order.
    Errors: `FleetError` where the folder has none.
    """

    def __init__(self, out: str | os.PathLike[str], lean: bool = False) -> None:
        import duckdb

        try:
            folder = pathlib.Path(path_of(out, "out"))
        except Error as why:
            raise FleetError(str(why)) from None
        tables = {
            "figures": _parquet(_figures(folder)),
            "machines": _one(folder / "machines.parquet", MACHINES),
            "logs": _one(folder / "logs.parquet", LEDGER),
        }
        self._refusal = duckdb.Error
        self._no_room = duckdb.OutOfMemoryException
        self._files = tempfile.TemporaryDirectory(prefix="plumb-")
        self._base = duckdb.connect(config=self._settings(lean))
        try:
            for name, table in tables.items():
                self._run(f"create view {name} as {table}")
            self._run(sql("views"))
            self._today = self._newest()
        except self._refusal as why:
            self.close()
            raise FleetError(f"{folder} can't be asked: {first_line(why)}") from None

    def _newest(self) -> str:
        """The last day of a log that counts on the day in its path, or has none there: a clock that
        is wrong must not make all other machines silent. Else the last day with data."""
        [[newest]] = self._run(NEWEST).fetchall()
        return str(newest)

    def _run(self, text: str, given: Any = None) -> Any:
        """The answer of DuckDB to SQL, of which no row is fetched yet."""
        try:
            return self._base.execute(text, given)
        except self._no_room:
            # What can't do with files has the memory of the machine.
            self._base.execute("reset memory_limit")
            return self._base.execute(text, given)

    def _settings(self, lean: bool) -> dict[str, Any]:
        settings: dict[str, Any] = {"temp_directory": self._files.name}
        return settings | {"threads": 1, "memory_limit": f"{LEAN_MB}MB"} if lean else settings

    def ask(self, question: str, **parameters: Any) -> pyarrow.Table:
        """The answer to a question of `QUESTIONS`, or to SQL; see `query`."""
        text, given = self._text(question, parameters)
        with self._in_words():
            answer = self._base.sql(text, params=given)
            if answer is None:
                raise FleetError("the SQL has no table as its answer: ask by select or from")
            return answer.to_arrow_table()

    def rows(self, question: str, **parameters: Any) -> Iterator[dict[str, Any]]:
        """The same row by row; ask no other question until all rows are taken."""
        given = self._text(question, parameters)
        with self._in_words():
            answer = self._run(*given)
            names = [column[0] for column in answer.description]
        while True:
            with self._in_words():
                some = answer.fetchmany(AT_ONCE)
            if not some:
                return
            yield from (dict(zip(names, row)) for row in some)

    def _text(self, question: str, parameters: dict[str, Any]) -> tuple[str, Any]:
        """The SQL of a question with its parameters."""
        text = sql(question) if question in QUESTIONS else question
        given = DEFAULTS | {"today": self._today} | parameters
        used = {name: given[name] for name in set(re.findall(r"\$(\w+)", text)) & set(given)}
        return text, used or None

    @contextlib.contextmanager
    def _in_words(self) -> Iterator[None]:
        """Errors of DuckDB as `FleetError`."""
        try:
            yield
        except self._refusal as why:
            raise FleetError(f"DuckDB can't answer the question: {first_line(why)}") from None
        except RuntimeError as why:
            # So DuckDB passes on the interruption that ends its query.
            if "interrupted" in str(why):
                raise KeyboardInterrupt from None
            raise

    def close(self) -> None:
        """Lets the folder go."""
        self._base.close()
        self._files.cleanup()

    def __enter__(self) -> Figures:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def query(out: str | os.PathLike[str], question: str, **parameters: Any) -> pyarrow.Table:
    """Asks the figures in a folder: the name of a question, or SQL.

    Parameters of the SQL (`$today`) are given by name; where they are not, `today` is the last day
    with data, `recent_days` 7, `least_days` 5 and `band_deg` null.
    Errors: `FleetError` where the folder has no figures or those of another version, the SQL is not
    valid, or a parameter is.
    """
    _refuse(question, parameters)
    with Figures(out) as figures:
        return figures.ask(question, **parameters)


def _refuse(question: str, parameters: dict[str, Any]) -> None:
    """Refuses what is neither a question nor SQL, and parameters that a question has not."""
    is_named = question in QUESTIONS
    if not is_named and (not isinstance(question, str) or re.fullmatch(r"\s*\w*\s*", question)):
        listed = ", ".join(QUESTIONS)
        raise FleetError(f"{question!r} is no question: give one of {listed}, or SQL")
    if is_named:
        refuse_parameters(parameters)
    own = sorted(set(re.findall(r"\$(\w+)", sql(question) if is_named else question)))
    for name in sorted(set(parameters) - {*DEFAULTS, "today", *own}):
        has = f"it has {', '.join(own)}" if own else "it has none"
        raise FleetError(f"the question has no parameter {name}: {has}")


def refuse_parameters(given: dict[str, Any]) -> None:
    """Refuses values that the questions can't have.

    Errors: `FleetError`.
    """
    today, band_deg = given.get("today"), given.get("band_deg")
    if today is not None and day_in(today) is None:
        raise FleetError(f"{today} is no day such as 2026-11-20")
    if band_deg is not None and not (_is_number(band_deg) and 0 < band_deg < 360):
        raise FleetError(f"{band_deg} deg is no band: give half of it, more than 0 deg")
    for name in ("recent_days", "least_days"):
        days = given.get(name, DEFAULTS[name])
        if not isinstance(days, int) or isinstance(days, bool) or days < 1:
            raise FleetError(f"{name} is {days!r}: give a whole number of days, 1 or more")


def day_in(given: object) -> str | None:
    """A day as 2026-11-20, out of that or of a date; None for what is none."""
    if isinstance(given, datetime.date):
        return given.isoformat()[:10]
    return given if isinstance(given, str) and day_of(given) == given else None


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _figures(folder: pathlib.Path) -> list[pathlib.Path]:
    places = [day / "rows.parquet" for day in days_of(folder / "figures").values()]
    files = [place for place in places if place.exists()]
    if not files:
        raise FleetError(f"{folder} has no figures of a fleet: name the folder of a run")
    return files


def _one(path: pathlib.Path, schema: pyarrow.Schema) -> str:
    if path.exists():
        refuse_other_format(path)
        return _parquet([path])
    # Without a table there is an empty one.
    columns = (f"{_EMPTY[field.type]} as {field.name}" for field in schema)
    return f"select {', '.join(columns)} limit 0"


_EMPTY = {pyarrow.string(): "''", pyarrow.int64(): "0"}
"""A value of each type."""


def _parquet(files: list[pathlib.Path]) -> str:
    """SQL for the rows of files, whatever letters are in their names."""
    names = (re.sub(r"([*?\[])", r"[\1]", str(path.absolute())) for path in files)
    listed = ", ".join("'" + name.replace("'", "''") + "'" for name in names)
    return f"select * from read_parquet([{listed}], hive_partitioning = false)"
