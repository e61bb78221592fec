"""The folder of the results: what a run may remove and what it puts right, and from which day all
is seen."""

from __future__ import annotations

import contextlib
import io
import json
import os
import pathlib
import subprocess
import sys
import zlib
from typing import Any

import pytest
from fleets import put, results, text, tree

from plumb.fleet import FleetError, Rules, asking, query, run, visits
from plumb.fleet.__main__ import main


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    return tree(tmp_path_factory.mktemp("folder") / "logs", 1, 2)


OWN = (
    "machines/notes/x.txt",
    "figures/2026-01-01/plot.png",
    "summaries/2026-01-01/mine.csv",
    "figures/day=mine/x.txt",
    "figures/day=2026-01-02/x.txt",
)


def test_a_run_removed_folders_of_a_person(logs: pathlib.Path, tmp_path: pathlib.Path) -> None:
    out = tmp_path / "out"
    own = [put(out / name, "mine") for name in OWN]
    with pytest.raises(FleetError, match="out has figures in it and no results of a fleet: name an"):
        run(logs, out)
    assert all(path.read_text() == "mine" for path in own)
    put(out / ".lock", "")
    (out / "machines/linked").symlink_to(put(tmp_path / "else/report.html", "mine").parent)
    (out / "figures/2026-01-03").symlink_to(put(tmp_path / "more/rows.parquet", "mine").parent)
    run(logs, out)
    assert run(logs, out).read == 0
    assert all(path.read_text() == "mine" for path in own)
    assert (tmp_path / "else/report.html").exists() and (tmp_path / "more/rows.parquet").exists()


def test_a_page_and_a_day_of_a_run_are_removed_and_what_else_is_there_stays(
    tmp_path: pathlib.Path,
) -> None:
    root, out = tmp_path / "logs", tmp_path / "out"
    day = "2026-11-20"
    log = put(root / "m1" / f"{day}.log", text(day, 1, "+1 s fault b stuck"))
    assert run(root, out).visits == ["m1"]
    notes = [put(out / kind / "notes.txt", "mine") for kind in ("machines/m1", f"figures/{day}")]
    put(log, text("2026-11-21", 1))
    log.rename(log.with_name("2026-11-21.log"))
    (out / "logs.parquet").unlink()
    (out / ".logs.parquet").unlink()
    assert run(root, out).visits == []
    assert [path.read_text() for path in notes] == ["mine", "mine"]
    assert [path.name for path in (out / "machines/m1").iterdir()] == ["notes.txt"]
    assert not (out / "summaries" / day).exists()


def test_a_damaged_ledger_was_to_be_removed_with_all_that_is_gone(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root, out = tree(tmp_path / "logs", 1, 2), tmp_path / "out"
    before = run(root, out)
    (root / "m1/2026-11-20.log").unlink()
    put(out / "logs.parquet", "no table")
    outcome = run(root, out)
    assert (outcome.logs, outcome.frames, outcome.read) == (before.logs, before.frames, 0)
    for name in ("logs.parquet", ".logs.parquet"):
        put(out / name, "no table")
    assert main([str(root), str(out)]) == 2
    said = capsys.readouterr().err
    assert "logs.parquet is damaged" in said
    assert "or remove it; logs that are gone no longer count then" in said


@pytest.mark.parametrize("kind", ["figures", "summaries"])
def test_a_table_that_was_damaged_before_its_end_ended_each_run(
    kind: str, tmp_path: pathlib.Path
) -> None:
    root, out = tmp_path / "logs", tmp_path / "out"
    day = "2026-11-20"
    put(root / "m1" / f"{day}.log", text(day, 1, "+1 s fault b stuck"))
    run(root, out)
    before = results(out)
    table = out / kind / day / "rows.parquet"
    whole = bytearray(table.read_bytes())
    whole[4:200] = bytes(196)
    table.write_bytes(whole)
    assert run(root, out).visits == ["m1"]
    assert results(out) == before


@pytest.mark.parametrize("body", [b"", b"{}", b'{"format":"plumb-summary","version":92,'])
def test_a_kept_summary_that_is_none_ended_the_run(body: bytes, tmp_path: pathlib.Path) -> None:
    root, out = tree(tmp_path / "logs", 1, 1), tmp_path / "out"
    before = run(root, out)
    [kept] = [path for path in (out / "logs").rglob("*") if path.is_file()]
    head = kept.read_bytes().partition(b"\n")[0]
    kept.write_bytes(head + b"\n" + zlib.compress(body))
    (out / "figures/2026-11-20/rows.parquet").unlink()
    outcome = run(root, out)
    assert (outcome.read, outcome.frames) == (1, before.frames)


@pytest.mark.parametrize(("name", "value"), [("frames", 10**30), ("first_ns", "x"), ("error", 5)])
def test_a_kept_summary_with_a_field_of_another_type_ended_the_run(
    name: str, value: Any, tmp_path: pathlib.Path
) -> None:
    root, out = tree(tmp_path / "logs", 1, 1), tmp_path / "out"
    before = run(root, out)
    [kept] = [path for path in (out / "logs").rglob("*") if path.is_file()]
    head, _, body = kept.read_bytes().partition(b"\n")
    fields = json.loads(head) | {name: value}
    del fields["crc32"]
    kept.write_bytes(json.dumps(fields).encode() + b"\n" + body)
    put(out / ".journal", json.dumps({"log": "\ud800", "key": "k", "size": 10**30}) + "\n")
    outcome = run(root, out)
    assert (outcome.read, outcome.frames) == (1, before.frames)


def test_days_behind_today_were_not_left_out(tmp_path: pathlib.Path) -> None:
    root, out = tree(tmp_path / "logs", 1, 4), tmp_path / "out"
    run(root, out)
    assert [visit.machine for visit in visits(out)] == ["m1"]
    assert visits(out, Rules(today="2026-11-21")) == []
    assert visits(out, Rules(today="2026-11-22")) != []
    for question in asking.QUESTIONS:
        for row in query(out, question, today="2026-11-21").to_pylist():
            days = [str(value) for name, value in row.items() if name in ("date", "last_day")]
            assert all(day <= "2026-11-21" for day in days), (question, row)
    [silent] = query(out, "silent", today="2026-11-26").to_pylist()
    assert silent["silent_now"] == 3


def test_one_log_with_a_wrong_clock_made_all_machines_silent(tmp_path: pathlib.Path) -> None:
    root = tmp_path / "logs"
    for machine in (1, 2):
        put(root / f"m{machine}/2026-11-20.log", text("2026-11-20", machine))
    put(root / "m2/2026-11-21.log", text("2036-01-01", 2))
    outcome = run(root, tmp_path / "out")
    assert outcome.visits == []
    assert "counted on 2036-01-01" in outcome.notes[str(root / "m2/2026-11-21.log")]


def test_a_day_whose_last_row_has_no_figures_had_the_fault_of_the_day_before(
    tmp_path: pathlib.Path,
) -> None:
    assert "arg_max(" not in asking.sql("standing")


def test_a_machine_behind_a_link_was_taken_for_a_link_to_nowhere(
    logs: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    root, out = tmp_path / "linked", tmp_path / "linked/results"
    root.mkdir()
    (root / "m1").symlink_to(logs / "m1")
    put(root / "m2/x", "").unlink()
    (root / "m2/2026-11-25.log").symlink_to(put(tmp_path / "a.log", text("2026-11-25", 2)))
    outcome = run(root, out)
    assert (outcome.machines, outcome.logs, outcome.failed) == (2, 3, {})
    assert run(root, out).read == 0
    put(tmp_path / "a.log", text("2026-11-25", 3), 500.0)
    assert run(root, out).read == 1
    (root / "m2/loop").symlink_to("..")
    [sentence] = run(root, out).failed.values()
    assert sentence.endswith("it is a link to a folder that it is in")


def test_results_below_the_logs_were_taken_for_logs_behind_a_link(
    logs: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    (tmp_path / "link").symlink_to(logs)
    for _ in range(2):
        outcome = run(tmp_path / "link", logs / "results")
        assert (outcome.logs, outcome.notes, outcome.failed) == (2, {}, {})


WRONG: list[tuple[str, Any]] = [
    ("logs", None), ("logs", 5), ("logs", b"logs"), ("out", None), ("out", b"o"), ("out", "a\0b"),
    ("pattern", None), ("workers", "2"), ("workers", 2.5), ("rules", None), ("progress", 5),
    ("manifest", 5), ("logs", "\ud800"), ("eds", "x.eds@1"), ("logs", "zip://a::file://b.zip"),
]


@pytest.mark.parametrize(("name", "value"), WRONG)
def test_words_of_a_wrong_type_ended_in_a_traceback(
    name: str, value: Any, logs: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    given = {"logs": logs, "out": tmp_path / "out"} | {name: value}
    with pytest.raises(FleetError, match=r": (give|unpack|name|No such)|can't be read"):
        run(**given)
    for wrong in (None, 5, b"out"):
        with pytest.raises(FleetError, match="^out is "):
            query(wrong, "drift")


def test_a_folder_that_can_not_be_written_ended_in_a_traceback(
    logs: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", "x")

    monkeypatch.setattr("plumb.fleet.store.Store.note", full)
    with pytest.raises(FleetError, match="^x can't be used: No space left on device; "):
        run(logs, tmp_path / "out")


def test_a_terminal_that_is_plain_closed_or_full_ended_in_a_traceback(
    logs: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    out = tmp_path / "out-ä"
    plain = io.TextIOWrapper(io.BytesIO(), encoding="ascii", write_through=True)
    with contextlib.redirect_stdout(plain):
        assert main([str(logs), str(out)]) == 0
    assert isinstance(plain.buffer, io.BytesIO)
    assert rb"out-\xe4" in plain.buffer.getvalue()
    words = [sys.executable, "-m", "plumb.fleet", str(logs), str(out)]
    ends, begins = os.pipe()
    os.close(ends)
    done = subprocess.run(words, stdout=begins, stderr=subprocess.PIPE, timeout=100)
    os.close(begins)
    assert (done.returncode, done.stderr) == (0, b"")
    if os.path.exists("/dev/full"):
        with open("/dev/full", "w") as full:
            done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, timeout=100)
        assert done.returncode == 2 and done.stderr.count(b"\n") == 1
