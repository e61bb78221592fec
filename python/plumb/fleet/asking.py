"""Questions to the figures of a fleet: SQL on DuckDB, over the Parquet in its folder.

In: the folder, and the name of a question in `queries/` or SQL of one's own. Out: a table. The
tables are `figures`, `machines` and `logs`, and the view `machine_days`; docs/fleet.md lists their
columns.
"""

from __future__ import annotations

import importlib.resources
import os
import pathlib
import re
from typing import Any

import pyarrow
import pyarrow.dataset

from .errors import FleetError, first_line
from .figures import SCHEMA
from .store import LEDGER, MACHINES, refuse_other_format

QUESTIONS = ("faults", "drift", "histories", "calibration", "restarts", "silent", "standing")
"""The questions that have a file in `queries/`."""


def sql(name: str) -> str:
    """The text of a question, or of the views."""
    return importlib.resources.files(__package__).joinpath(f"queries/{name}.sql").read_text()


class Figures:
    """The figures in a folder, opened for questions; close it, or use it in a `with`.

    Errors: `FleetError` where the folder has none.
    """

    def __init__(self, out: str | os.PathLike[str]) -> None:
        import duckdb

        folder = pathlib.Path(out)
        tables = {
            "figures": _figures(folder),
            "machines": _one(folder / "machines.parquet", MACHINES),
            "logs": _one(folder / "logs.parquet", LEDGER),
        }
        self._refusal = duckdb.Error
        self._today = max(path.name.removeprefix("day=") for path in folder.glob("figures/day=*"))
        self._base = duckdb.connect()
        for name, table in tables.items():
            self._base.register(name, table)
        self._base.execute(sql("views"))

    def ask(self, question: str, **parameters: Any) -> pyarrow.Table:
        """The answer to a question of `QUESTIONS`, or to SQL; see `query`."""
        text = sql(question) if question in QUESTIONS else question
        given = {"recent_days": 7, "least_days": 5, "band_deg": None, "today": self._today}
        given |= parameters
        used = {name: given[name] for name in set(re.findall(r"\$(\w+)", text)) & set(given)}
        try:
            return self._base.sql(text, params=used or None).to_arrow_table()
        except (self._refusal, AttributeError) as why:
            raise FleetError(f"DuckDB can't answer the question: {first_line(why)}") from None
        except RuntimeError as why:
            # So DuckDB passes on the interruption that ends its query.
            if "interrupted" in str(why):
                raise KeyboardInterrupt from None
            raise

    def rows(self, question: str, **parameters: Any) -> list[dict[str, Any]]:
        """The same as a list of rows."""
        return self.ask(question, **parameters).to_pylist()

    def close(self) -> None:
        """Lets the folder go."""
        self._base.close()

    def __enter__(self) -> Figures:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def query(out: str | os.PathLike[str], question: str, **parameters: Any) -> pyarrow.Table:
    """Asks the figures in a folder: the name of a question, or SQL.

    Parameters of the SQL (`$today`) are given by name; where they are not, `today` is the last day
    with data, `recent_days` 7, `least_days` 5 and `band_deg` null.
    Errors: `FleetError` where the folder has no figures or those of another version, or the SQL is
    not valid.
    """
    with Figures(out) as figures:
        return figures.ask(question, **parameters)


def _figures(folder: pathlib.Path) -> Any:
    files = sorted(str(path) for path in folder.glob("figures/day=*/rows.parquet"))
    if not files:
        raise FleetError(f"{folder} has no figures of a fleet: name the folder of a run")
    return pyarrow.dataset.dataset(files, schema=SCHEMA, format="parquet")


def _one(path: pathlib.Path, schema: pyarrow.Schema) -> Any:
    if not path.exists():
        return schema.empty_table()
    refuse_other_format(path)
    return pyarrow.dataset.dataset(str(path), schema=schema, format="parquet")
