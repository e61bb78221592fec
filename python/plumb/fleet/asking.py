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

from .errors import FleetError
from .figures import SCHEMA
from .layout import _short
from .store import LEDGER, MACHINES

QUESTIONS = ("faults", "drift", "histories", "calibration", "restarts", "silent", "standing")
"""The questions that have a file in `queries/`."""


def sql(name: str) -> str:
    """The text of a question, or of the views."""
    return importlib.resources.files(__package__).joinpath(f"queries/{name}.sql").read_text()


def query(out: str | os.PathLike[str], question: str, **parameters: Any) -> pyarrow.Table:
    """Asks the figures in a folder: the name of a question, or SQL.

    Parameters of the SQL (`$today`) are given by name; where they are not, `today` is the last day
    with data, `recent_days` 7, `least_days` 5 and `band_deg` null.
    Errors: `FleetError` where the folder has no figures, or DuckDB refuses the SQL.
    """
    import duckdb

    folder = pathlib.Path(out)
    text = sql(question) if question in QUESTIONS else question
    with duckdb.connect() as base:
        tables = [_figures(folder), _one(folder / "machines.parquet", MACHINES)]
        tables.append(_one(folder / "logs.parquet", LEDGER))
        for name, table in zip(("figures", "machines", "logs"), tables):
            base.register(name, table)
        try:
            base.execute(sql("views"))
            given = {"recent_days": 7, "least_days": 5, "band_deg": None} | parameters
            if "today" not in given:
                given["today"] = _last_day(folder)
            used = set(re.findall(r"\$(\w+)", text))
            used_ones = {name: value for name, value in given.items() if name in used}
            return base.sql(text, params=used_ones or None).to_arrow_table()
        except duckdb.Error as why:
            raise FleetError(f"DuckDB refuses the question: {_short(why)}") from None


def _figures(folder: pathlib.Path) -> Any:
    files = sorted(str(path) for path in folder.glob("figures/day=*/rows.parquet"))
    if not files:
        raise FleetError(f"{folder} has no figures of a fleet: name the folder of a run")
    return pyarrow.dataset.dataset(files, schema=SCHEMA, format="parquet")


def _one(path: pathlib.Path, schema: pyarrow.Schema) -> Any:
    if not path.exists():
        return schema.empty_table()
    return pyarrow.dataset.dataset(str(path), schema=schema, format="parquet")


def _last_day(folder: pathlib.Path) -> str:
    return max(path.name.removeprefix("day=") for path in folder.glob("figures/day=*"))
