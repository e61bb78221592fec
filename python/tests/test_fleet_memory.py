"""The memory of a run over a fleet does not grow with the number of logs, and days of many logs are
merged in several steps with the bytes of one."""

from __future__ import annotations

import datetime
import gc
import pathlib
import sys
import tracemalloc
from collections import Counter

import pytest
from conftest import candump
from fleets import frames, put, results, tree

import plumb
from plumb import Error
from plumb.fleet import FleetError, asking, merging, query, run, schedulers, scratch, store

FIRST = datetime.datetime(2026, 9, 1, tzinfo=datetime.timezone.utc)

MACHINE_DAYS = 100
"""Of both fleets that are compared; the one has a log for each of them, the other one several."""

SEVERAL = 8

MOST_FOR_EACH = 0.5
"""Objects that a log may take; a list of all paths takes one for each."""

EVERY = 50
"""Calls of the progress between two looks at the memory."""


def tiny(root: pathlib.Path, count: int, of_a_day: int) -> pathlib.Path:
    """So many logs of different contents, so many of them for each day of each machine."""
    lines = list(frames(1))[:40]
    for number in range(count):
        machine, day = divmod(number // of_a_day, 5)
        at = FIRST + datetime.timedelta(day)
        path = root / f"m{machine:04}" / f"{at.date()}" / f"{number:06}.log"
        put(path, candump(lines, at.timestamp() + 8 * number))
    return root


class Look:
    """Counts Python's objects now and then in a run: each has a block of memory of its own."""

    def __init__(self) -> None:
        self.calls = 0
        self.most = 0

    def __call__(self, stage: str, jobs: int, *_: float) -> None:
        if self.calls % EVERY == 0:
            # It also gives back the blocks that Python keeps for the next objects.
            gc.collect()
            self.most = max(self.most, sys.getallocatedblocks())
        self.calls += 1


def held(logs: pathlib.Path, out: pathlib.Path) -> int:
    """The most objects that are there at once in a run, without those before it."""
    look = Look()
    gc.collect()
    before = sys.getallocatedblocks()
    run(logs, out, workers=1, progress=look)
    return look.most - before


def test_memory_does_not_grow_with_the_number_of_logs(tmp_path: pathlib.Path) -> None:
    few = tiny(tmp_path / "few", MACHINE_DAYS, 1)
    many = tiny(tmp_path / "many", MACHINE_DAYS * SEVERAL, SEVERAL)
    # What is loaded once, in a run that reads logs and in one that finds them finished.
    for _ in range(2):
        run(tiny(tmp_path / "first", 2, 1), tmp_path / "out")
    # The second runs read nothing, and take all from what is kept.
    for _ in range(2):
        least, most = held(few, tmp_path / "out of few"), held(many, tmp_path / "out of many")
        assert most - least < MOST_FOR_EACH * MACHINE_DAYS * (SEVERAL - 1), (least, most)


def test_a_day_of_many_logs_is_merged_in_steps_and_gives_the_same_bytes(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tiny(tmp_path / "logs", 24, 11)
    run(root, tmp_path / "at once", workers=1)
    monkeypatch.setattr(merging, "PARTS", 2)
    shown: list[tuple[int, int]] = []

    def look(stage: str, jobs: int, all_jobs: int, *_: float) -> None:
        if stage == "merging":
            shown.append((jobs, all_jobs))

    run(root, tmp_path / "in steps", workers=1, progress=look)
    assert results(tmp_path / "in steps") == results(tmp_path / "at once")
    # 11 logs are merged to 6, 3, 2 and 1; the 2 of the last day to 1.
    assert shown == [(done, 25) for done in range(1, 26)]


def test_a_damaged_summary_among_many_of_a_day_is_made_again(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(merging, "PARTS", 2)
    root, out = tiny(tmp_path / "logs", 9, 7), tmp_path / "out"
    run(root, out)
    before = results(out)
    [victim, *_] = sorted(path for path in (out / "logs").rglob("*") if path.is_file())
    victim.write_bytes(victim.read_bytes()[:-20])
    for path in (out / "figures").rglob("*.parquet"):
        path.unlink()
    outcome = run(root, out)
    assert (outcome.read, outcome.skipped, outcome.failed) == (1, 8, {})
    assert results(out) == before


def test_the_summaries_of_a_changed_day_were_read_twice(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, out = tiny(tmp_path / "logs", 6, 3), tmp_path / "out"
    run(root, out)
    tiny(tmp_path / "logs", 7, 4)
    reads: Counter[str] = Counter()
    summary = store.Store.summary

    def count(self: store.Store, blake3: str) -> bytes:
        reads[blake3] += 1
        return summary(self, blake3)

    monkeypatch.setattr(store.Store, "summary", count)
    run(root, out)
    assert reads and set(reads.values()) == {1}


def test_a_run_without_room_for_its_temporary_file_is_told(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = "; pragma max_page_count = 40;"
    monkeypatch.setattr(scratch, "TABLES", scratch.TABLES + room)
    root = tiny(tmp_path / "logs", 600, 100)
    with pytest.raises(FleetError, match="the temporary file of the run can't be used: .* full"):
        run(root, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_interrupted_run_reports_nothing_of_its_temporary_file(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(stage: str, *_: float) -> None:
        if stage == "merging":
            raise KeyboardInterrupt

    reported: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", reported.append)
    with pytest.raises(KeyboardInterrupt):
        run(tree(tmp_path / "logs", 2, 2), tmp_path / "out", workers=1, progress=interrupt)
    gc.collect()
    assert not reported


def test_letters_with_a_meaning_in_patterns_may_be_in_the_folder(tmp_path: pathlib.Path) -> None:
    out = tmp_path / "it's [o]*?.d"
    assert run(tree(tmp_path / "logs", 1, 2), out).logs == 2
    assert query(out, "from figures").num_rows == 2
    assert query(out, "from logs").num_rows == 2


def test_a_question_that_needs_more_memory_than_a_page_has_is_answered(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tree(tmp_path / "logs", 2, 3)
    run(root, tmp_path / "wanted")
    monkeypatch.setattr(asking, "LEAN_MB", 1)
    run(root, tmp_path / "out")
    assert results(tmp_path / "out") == results(tmp_path / "wanted")


def test_the_figures_of_a_page_were_refused_where_opening_them_needed_more_memory(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(tree(tmp_path / "logs", 1, 2), tmp_path / "out")
    monkeypatch.setattr(asking, "LEAN_MB", 0.1)
    with asking.Figures(tmp_path / "out", lean=True) as figures:
        assert list(figures.rows("from figures"))


def test_dask_keeps_few_of_the_messages_that_summaries_are_in() -> None:
    def length(jobs: list[bytes]) -> list[int]:
        return [len(job) for job in jobs]

    with schedulers.opened(None, 2) as place:
        assert isinstance(place, schedulers.Dask)
        tracemalloc.start()
        try:
            for _ in place.map(length, ((bytes(9000), 1) for _ in range(64 * 60))):
                pass
            gc.collect()
            held = tracemalloc.get_traced_memory()[0]
        finally:
            tracemalloc.stop()
        log = place._client.run_on_scheduler(lambda dask_scheduler: dask_scheduler.transition_log)
    # All of them are 34 MB.
    assert held < 12e6
    assert len(log) <= schedulers.KEPT


@pytest.mark.parametrize(
    ("nodes", "sentence"),
    [
        ("12", "'12' is no list of node-ids: write it as [1, 2]"),
        (b"12", "b'12' is no list of node-ids: write it as [1, 2]"),
        (12, "12 is no list of node-ids: write it as [1, 2]"),
        (["1", "2"], "'1' is no node-id: give a whole number of 1 to 127"),
        ([1.0, 2.0], "1.0 is no node-id: give a whole number of 1 to 127"),
        ([None, 2], "None is no node-id: give a whole number of 1 to 127"),
        ([1, 128], "128 is no node-id: give 1 to 127"),
    ],
)
def test_nodes_of_another_type_ended_in_a_type_error(
    nodes: object, sentence: str, tmp_path: pathlib.Path
) -> None:
    root = tree(tmp_path / "logs", 1, 1)
    with pytest.raises(FleetError) as fleet:
        run(root, tmp_path / "out", nodes=nodes)  # type: ignore[arg-type]
    with pytest.raises(Error) as one:
        plumb.summarise(root / "m1/2026-11-20.log", nodes=nodes)  # type: ignore[arg-type]
    assert str(fleet.value) == str(one.value) == sentence
    assert not (tmp_path / "out").exists()
