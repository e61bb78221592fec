"""A fleet as a Spark job gives the bytes of one process. `cargo xtask fleet-spark` runs it: Spark
needs Java and half a gigabyte, so it is no part of every run."""

from __future__ import annotations

import os
import pathlib
import sys
from collections.abc import Iterator

import pytest
from fleets import put, results, tree
from pyspark.sql import SparkSession

from plumb.fleet import FleetError, run, schedulers, spark


@pytest.fixture(scope="module")
def session() -> Iterator[SparkSession]:
    os.environ["PYSPARK_PYTHON"] = sys.executable
    builder = SparkSession.builder.master("local[2]").appName("plumb")
    session = builder.config("spark.ui.enabled", "false").getOrCreate()
    yield session
    session.stop()


def test_spark_gives_the_bytes_of_one_process(
    session: SparkSession, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(schedulers, "GROUP", 1)
    root = tree(tmp_path / "logs", 3, 4)
    junk = put(root / "m1/2026-11-29.log", b"no log\n" * 40)
    one = run(root, tmp_path / "one", workers=1)
    outcome = spark.run(session, root, tmp_path / "spark")
    assert (outcome.read, outcome.logs) == (13, 12) and list(outcome.failed) == [str(junk)]
    assert outcome.failed == one.failed
    assert results(tmp_path / "spark") == results(tmp_path / "one")
    assert spark.run(session, root, tmp_path / "spark").skipped == 13


def test_a_function_that_fails_is_one_sentence(session: SparkSession) -> None:
    def fail(jobs: list[int]) -> list[int]:
        raise ValueError("no")

    with pytest.raises(FleetError, match="Spark can't do it: ValueError: no"):
        list(spark.Spark(session).map(fail, [(1, 1)]))
