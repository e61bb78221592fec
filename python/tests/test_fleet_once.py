"""What becomes of logs between two runs: each content counts once, and none is lost."""

from __future__ import annotations

import gzip
import pathlib
from collections.abc import Callable, Iterator
from typing import Any

import pyarrow
import pyarrow.parquet
import pytest
from fleets import put, text, tree

import plumb
from plumb.fleet import FleetError, run, schedulers, work


def lines(out: pathlib.Path) -> dict[str, dict]:
    """The lines of logs.parquet, by the log's path from its machine on."""
    rows = pyarrow.parquet.ParquetFile(out / "logs.parquet").read().to_pylist()
    return {"/".join(row["log"].split("/")[-2:]): row for row in rows}


DAY = "2026-11-20"


def unpacked(folder: pathlib.Path, content: bytes) -> None:
    put(folder / f"{DAY}.log", content)


def packed_again(folder: pathlib.Path, content: bytes) -> None:
    put(folder / f"{DAY}.log.9.gz", gzip.compress(content, 9, mtime=0))


@pytest.mark.parametrize("again", [unpacked, packed_again])
def test_a_log_that_was_unpacked_or_packed_again_in_place_counted_twice(
    again: Callable[[pathlib.Path, bytes], None], tmp_path: pathlib.Path
) -> None:
    folder, content = tmp_path / "logs/m1", text(DAY).encode()
    before = put(folder / f"{DAY}.log.gz", gzip.compress(content, 1, mtime=0))
    frames = run(tmp_path / "logs", tmp_path / "out").frames
    before.unlink()
    again(folder, content)
    outcome = run(tmp_path / "logs", tmp_path / "out")
    assert (outcome.logs, outcome.frames) == (1, frames)
    [note] = outcome.notes.items()
    assert note[0] == str(before) and "has the same beginning or all of it: counted once" in note[1]
    assert run(tmp_path / "logs", tmp_path / "out").frames == frames
    [log] = folder.iterdir()
    log.unlink()
    put(tmp_path / "logs/m2" / f"{DAY}.log", text(DAY, 2))
    assert run(tmp_path / "logs", tmp_path / "out").logs == 2


@pytest.mark.parametrize("name", [f"{DAY}.log.gz", f"{DAY}.log.1", f"{DAY}.log.1.gz"])
def test_a_log_that_grew_and_was_renamed_or_packed_counted_in_part_twice(
    name: str, tmp_path: pathlib.Path
) -> None:
    whole = text(DAY).encode()
    half = whole[: whole.index(b"\n", len(whole) // 2) + 1]
    log = put(tmp_path / "logs/m1" / f"{DAY}.log", half)
    run(tmp_path / "logs", tmp_path / "out")
    log.unlink()
    put(log.with_name(name), gzip.compress(whole, mtime=0) if name.endswith("gz") else whole)
    outcome = run(tmp_path / "logs", tmp_path / "out")
    assert (outcome.logs, outcome.frames) == (1, whole.count(b"\n"))
    assert list(outcome.notes) == [str(log)]


def test_logs_that_begin_together_and_were_both_there_count_each(tmp_path: pathlib.Path) -> None:
    first = put(tmp_path / "logs/m1" / f"{DAY}-a.log", text(DAY, 1))
    put(tmp_path / "logs/m1" / f"{DAY}-b.log", text(DAY, 2))
    before = run(tmp_path / "logs", tmp_path / "out")
    first.unlink()
    assert run(tmp_path / "logs", tmp_path / "out").frames == before.frames


def test_a_log_that_could_not_be_unpacked_to_be_compared_counted_twice_in_silence(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = text(DAY).encode()
    put(tmp_path / "logs/m1" / f"{DAY}.log", content)
    put(tmp_path / "logs/m1" / f"{DAY}.log.gz", gzip.compress(content, mtime=0))

    def full(*_: object) -> bool:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(work, "_unpacked", full)
    outcome = run(tmp_path / "logs", tmp_path / "out")
    [sentence] = outcome.incomplete.values()
    assert sentence.endswith("could not be unpacked and compared: No space left on device")
    monkeypatch.undo()
    outcome = run(tmp_path / "logs", tmp_path / "out")
    assert (outcome.logs, outcome.incomplete) == (1, {})


def test_a_log_and_its_packed_one_in_a_folder_with_two_colons_counted_twice(
    tmp_path: pathlib.Path,
) -> None:
    content = text(DAY).encode()
    put(tmp_path / "logs/crane::1" / f"{DAY}.log", content)
    put(tmp_path / "logs/crane::1" / f"{DAY}.log.gz", gzip.compress(content, mtime=0))
    assert run(tmp_path / "logs", tmp_path / "out").logs == 1


def unreadable(log: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(log, text(DAY, 2), 500.0)
    lost = work.Read(None, False, error=f"{work.HERE} is being written: the next run counts it")
    monkeypatch.setattr(work, "read_all", lambda logs, _: [lost for _ in logs])


def to_nowhere(log: pathlib.Path, _: pytest.MonkeyPatch) -> None:
    log.unlink()
    log.symlink_to("nowhere")


@pytest.mark.parametrize("happen", [unreadable, to_nowhere])
def test_a_log_that_could_not_be_read_once_lost_what_it_had_counted(
    happen: Callable[[pathlib.Path, pytest.MonkeyPatch], None],
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    root, out = tree(tmp_path / "logs", 1, 2), tmp_path / "out"
    before = run(root, out)
    log = root / "m1" / f"{DAY}.log"
    happen(log, monkeypatch)
    for _ in range(2):
        outcome = run(root, out)
        assert (outcome.logs, outcome.frames) == (before.logs, before.frames)
        [sentence] = outcome.incomplete.values()
        assert str(log) in sentence and sentence.endswith("what was read of it before counts")
    monkeypatch.undo()
    log.unlink()
    outcome = run(root, out)
    assert (outcome.logs, outcome.frames, outcome.incomplete) == (before.logs, before.frames, {})


class Wrong:
    """A scheduler that yields some groups of a function so many times."""

    def __init__(self, name: str, times: int) -> None:
        self._name, self._times = name, times

    def map(self, function: Callable[..., list], jobs: Any, *more: Any) -> Iterator[tuple]:
        for number, group in enumerate(schedulers.groups(jobs, 1)):
            is_wrong = number == 1 and function.__name__ == self._name
            for _ in range(self._times if is_wrong else 1):
                yield group, function(group, *more)


@pytest.mark.parametrize("name", ["read_all", "join"])
@pytest.mark.parametrize(("times", "sentence"), [(0, "has not yielded 1 of the jobs"), (2, "twice")])
def test_a_scheduler_that_dropped_or_repeated_a_group_lost_logs_in_silence(
    name: str, times: int, sentence: str, tmp_path: pathlib.Path
) -> None:
    root = tree(tmp_path / "logs", 1, 3)
    with pytest.raises(FleetError, match=sentence):
        run(root, tmp_path / "out", scheduler=Wrong(name, times))


def manifest(tmp_path: pathlib.Path, **columns: Any) -> pathlib.Path:
    """A manifest of one log with these columns more."""
    put(tmp_path / "logs/a.log", text(DAY))
    table = {"path": ["a.log"], "machine": ["m"]} | {key: [value] for key, value in columns.items()}
    pyarrow.parquet.write_table(pyarrow.table(table), tmp_path / "m.parquet")
    return tmp_path / "m.parquet"


@pytest.mark.parametrize("day", ["2026-1-11", "1.9.2026", "2026-11-200", "2026.11-20", "20.11.26"])
def test_a_day_of_a_manifest_in_another_form_was_taken_for_another_day(
    day: str, tmp_path: pathlib.Path
) -> None:
    outcome = None
    with pytest.raises(FleetError, match="there is no log to count.* is no day such as 2026-11-20"):
        outcome = run(tmp_path / "logs", tmp_path / "out", manifest=manifest(tmp_path, day=day))
    assert outcome is None
    with pytest.raises(FleetError, match="calibration_due .* is no day such as 2026-11-20"):
        table = manifest(tmp_path, calibration_due=day)
        run(tmp_path / "logs", tmp_path / "out", manifest=table)


@pytest.mark.parametrize("day", ["", " ", "2026.11.20", "20261120", "2026-11-20T08:00:00"])
def test_an_empty_day_of_a_manifest_was_refused(day: str, tmp_path: pathlib.Path) -> None:
    outcome = run(tmp_path / "logs", tmp_path / "out", manifest=manifest(tmp_path, day=day))
    assert (outcome.logs, outcome.notes, outcome.failed) == (1, {}, {})


def test_a_check_sum_of_a_manifest_that_was_a_number_was_another_one(tmp_path: pathlib.Path) -> None:
    table = manifest(tmp_path, certificate_crc32=0x0A2B3C4D)
    run(tmp_path / "logs", tmp_path / "out", manifest=table)
    [row] = pyarrow.parquet.ParquetFile(tmp_path / "out/machines.parquet").read().to_pylist()
    assert row["certificate_crc32"] == "0A2B3C4D"


@pytest.mark.parametrize("value", [{"certificate_crc32": 1.5}, {"certificate_sha256": 5}])
def test_a_check_sum_of_a_manifest_that_is_none_was_taken(
    value: dict[str, Any], tmp_path: pathlib.Path
) -> None:
    with pytest.raises(plumb.Error, match=f"m.parquet: {next(iter(value))} .*: give "):
        run(tmp_path / "logs", tmp_path / "out", manifest=manifest(tmp_path, **value))
