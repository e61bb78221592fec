"""The tables of a fleet as other programs read them, and those of earlier versions."""

from __future__ import annotations

import os
import pathlib
import signal
import subprocess
import sys
import time

import duckdb
import pyarrow.dataset
import pyarrow.parquet
import pytest
from fleets import put, results, tree

from plumb.fleet import query, run, store, work


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    return tree(tmp_path_factory.mktemp("fleet") / "logs", 2, 3)


@pytest.fixture(scope="module")
def out(logs: pathlib.Path) -> pathlib.Path:
    run(logs, logs.parent / "out")
    return logs.parent / "out"


DAYS = ["2026-11-20", "2026-11-20", "2026-11-21", "2026-11-21", "2026-11-22", "2026-11-22"]


@pytest.mark.parametrize("kind", store.KINDS)
def test_the_tables_of_all_days_were_refused_as_one_for_a_column_of_two_types(
    kind: str, out: pathlib.Path
) -> None:
    folder = str(out / kind)
    whole = pyarrow.parquet.read_table(folder)
    assert whole.schema.field("day").type == pyarrow.string()
    assert sorted(whole.column("day").to_pylist()) == DAYS
    parts = pyarrow.dataset.dataset(folder, partitioning="hive").to_table(columns=["day"])
    assert sorted(parts.column("day").to_pylist()) == DAYS
    found = duckdb.sql(f"select day from '{folder}/*/rows.parquet' order by day").fetchall()
    assert found == [(day,) for day in DAYS]


@pytest.mark.parametrize("kind", store.KINDS)
@pytest.mark.parametrize("name", ["pandas", "polars", "dask.dataframe"])
def test_libraries_read_the_tables_of_all_days_as_one(
    name: str, kind: str, out: pathlib.Path
) -> None:
    library = pytest.importorskip(name)
    table = library.read_parquet(str(out / kind))
    column = table["day"].compute() if hasattr(table, "compute") else table["day"]
    assert sorted(str(day) for day in column) == DAYS


def test_only_the_stamp_of_a_young_file_differs_between_two_runs(tmp_path: pathlib.Path) -> None:
    root, out = tree(tmp_path / "logs", 1, 2), tmp_path / "out"
    young = root / "m1/2026-11-20.log"

    def lines() -> list[dict[str, object]]:
        run(root, out)
        return pyarrow.parquet.read_table(out / "logs.parquet").to_pylist()

    # Young for so long that a busy machine reads it in that time.
    written_s = time.time() + 6.0
    os.utime(young, (written_s, written_s))
    first = lines()
    stamps = [line.pop("stamp") for line in first]
    assert stamps[0] is None and stamps[1] is not None
    time.sleep(max(written_s - time.time(), 0.0) + work.SETTLED_S + 0.2)
    second = lines()
    assert [line.pop("stamp") for line in second] == [str(young.stat().st_mtime), stamps[1]]
    assert first == second


def test_a_run_that_was_killed_left_its_temporary_files_for_ever(tmp_path: pathlib.Path) -> None:
    root, out = tree(tmp_path / "logs", 1, 2), tmp_path / "out"
    script = """
import os, signal, sys
from plumb.fleet import run, store

def killed(*_):
    os.kill(os.getpid(), signal.SIGKILL)

count = 0
replace = os.replace

def die(source, target):
    global count
    count += 1
    killed() if count == int(sys.argv[3]) else replace(source, target)

store.os.replace = die
run(sys.argv[1], sys.argv[2], workers=1)
"""
    for at in (2, 1, 2):
        done = subprocess.run([sys.executable, "-c", script, str(root), str(out), str(at)])
        assert done.returncode == -signal.SIGKILL
    assert [path for path in out.rglob(".*.part")]
    for place in ("figures/2026-11-20/.x9a53ebh", "logs/0123456789ab/ab/.1tqy7u8s"):
        put(out / place, "of an earlier version")
    own = put(out / ".htaccess", "a person's own")
    run(root, out)
    kept = [out / ".lock", out / store.LEDGER_COPY]
    assert sorted(out.rglob(".*")) == [own, *kept]


def former(out: pathlib.Path) -> None:
    """Renames the folders of the days as an earlier version has called them."""
    for kind in store.KINDS:
        for day in list((out / kind).iterdir()):
            day.rename(day.with_name(f"day={day.name}"))


def test_a_folder_with_days_of_an_earlier_version_is_asked_and_gone_on_with(
    logs: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    out = tmp_path / "out"
    run(logs, out)
    before, wanted = results(out), query(out, "from figures order by machine, day")
    former(out)
    assert query(out, "from figures order by machine, day") == wanted
    assert run(logs, out).read == 0 and results(out) == before
    # An earlier version may have written to it again.
    former(out)
    (out / "figures" / "2026-11-20").mkdir()
    other = (out / "figures/day=2026-11-20/rows.parquet").read_bytes()
    put(out / "figures/2026-11-20/rows.parquet", other)
    assert query(out, "from figures order by machine, day") == wanted
    run(logs, out)
    assert results(out) == before
