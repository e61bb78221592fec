"""A fleet in one process: whatever happens to a tree of logs, each content counts once."""

from __future__ import annotations

import concurrent.futures
import gzip
import json
import os
import pathlib
import random
from collections.abc import Callable, Iterable, Iterator

import fsspec
import pyarrow.parquet
import pytest
from fleets import frames, put, results, text, tree

import plumb
from plumb import _plumb
from plumb.fleet import FleetError, filing, layout, query, run, schedulers, scratch, store, work
from plumb.fleet.__main__ import main
from plumb.fleet.progress import Bar, left


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    return tree(tmp_path_factory.mktemp("fleet") / "logs")


def lines(out: pathlib.Path) -> dict[str, dict]:
    """The lines of logs.parquet, by the log's path from its machine on."""
    rows = pyarrow.parquet.ParquetFile(out / "logs.parquet").read().to_pylist()
    return {"/".join(row["log"].split("/")[-2:]): row for row in rows}


def frames_counted(out: pathlib.Path) -> int:
    """Frames in the merged summaries of all days."""
    table = [pyarrow.parquet.ParquetFile(path).read() for path in (out / "summaries").rglob("*.parquet")]
    summaries = [summary for one in table for summary in one.column("summary").to_pylist()]
    return json.loads(plumb.merge(summaries))["logs"]["frames"]


def test_a_tree_of_logs_comes_to_days_and_a_page(logs: pathlib.Path, tmp_path: pathlib.Path) -> None:
    outcome = run(logs, tmp_path / "out")
    assert (outcome.machines, outcome.logs, outcome.read, outcome.skipped) == (3, 12, 12, 0)
    assert not outcome.failed and not outcome.incomplete and not outcome.notes
    assert outcome.visits == ["m3"] and "1 machine needs a visit" in outcome.verdict
    assert frames_counted(tmp_path / "out") == outcome.frames == sum(
        len(path.read_text().splitlines()) for path in logs.rglob("*.log")
    )
    page = outcome.page.read_text()
    assert 'href="machines/m3/report.html"' in page and "<script" not in page
    assert (tmp_path / "out/machines/m3/report.html").read_text().startswith("<!doctype html>")
    assert [path.name for path in (tmp_path / "out/machines").iterdir()] == ["m3"]
    table = query(tmp_path / "out", "select machine, day from machine_days")
    assert table.num_rows == 12


def test_a_day_of_a_machine_is_what_plumb_merge_makes_of_its_logs(tmp_path: pathlib.Path) -> None:
    parts = [
        put(tmp_path / "logs/m/2026-11-20" / f"{hour}.log", text("2026-11-20", 1, hour=hour))
        for hour in (6, 9, 12)
    ]
    run(tmp_path / "logs", tmp_path / "out")
    [row] = pyarrow.parquet.ParquetFile(
        tmp_path / "out/summaries/2026-11-20/rows.parquet"
    ).read().to_pylist()
    assert row["summary"] == plumb.merge(plumb.summarise(part) for part in reversed(parts))


def test_a_run_that_is_repeated_reads_nothing_and_changes_nothing(
    logs: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    out = tmp_path / "out"
    run(logs, out)
    before = results(out)
    times = {path: path.stat().st_mtime_ns for path in (out / "figures").rglob("*.parquet")}
    outcome = run(logs, out)
    assert (outcome.read, outcome.skipped, outcome.logs) == (0, 12, 12)
    assert results(out) == before
    assert times == {path: path.stat().st_mtime_ns for path in times}


def test_an_interrupted_run_is_gone_on_with(logs: pathlib.Path, tmp_path: pathlib.Path) -> None:
    def interrupt(stage: str, jobs: int, *_: float) -> None:
        if stage == "reading" and jobs == 5:
            raise KeyboardInterrupt

    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        run(logs, out, progress=interrupt)
    assert not (out / "report.html").exists() and not (out / "figures").exists()
    with (out / store.JOURNAL).open("a") as file:
        file.write('[1]\n{"log": ["x"], "key": "k"}\n{"log": "cut')
    outcome = run(logs, out)
    assert (outcome.read, outcome.skipped) == (7, 5)
    run(logs, tmp_path / "fresh")
    assert results(out) == results(tmp_path / "fresh")


def happen(draw: random.Random, root: pathlib.Path, step: int) -> None:
    """Something that happens to a tree of logs."""
    there = sorted(path for path in root.rglob("*") if path.is_file())
    day = f"2026-11-{draw.randint(20, 23)}"
    machine = draw.choice(["m1", "m 2", "mä'3%"])
    where = root / machine / f"{day}-{step}.log"
    age_s = 1000.0 - step
    what = draw.choice(
        ["new", "new", "append", "copy", "move", "cut", "zip", "pack", "pack", "junk", "jump"]
    )
    some = draw.choice(there) if there else None
    # What changes between two runs and is compressed then is gone, as it was, and another log.
    is_packed = some is not None and some.suffix == ".gz"
    if (what == "pack" and (is_packed or step % 3)) or (what == "append" and is_packed):
        what = "new"
    if what == "new" or some is None:
        put(where, text(day, draw.randint(1, 3), hour=draw.randint(0, 23)), age_s)
    elif what == "append":
        put(some, some.read_bytes() + text(day, 1, hour=23).encode(), age_s)
    elif what == "copy":
        put(where, some.read_bytes(), age_s)
    elif what == "move":
        where.parent.mkdir(exist_ok=True)
        some.rename(where)
    elif what == "cut":
        put(where, text(day, 2, hour=step % 24)[: 20_000 - 7 * step], age_s)
    elif what == "zip":
        put(where, gzip.compress(text(day, 3, hour=step % 24).encode(), mtime=0), age_s)
    elif what == "pack":
        put(some.with_name(f"{some.name}.gz"), gzip.compress(some.read_bytes(), mtime=0), age_s)
        some.unlink()
    elif what == "junk":
        put(where, draw.choice([b"", b"no log\n" * 30, bytes(range(256)) * 9]), age_s)
    else:
        put(where, text("2031-01-05", 1, hour=step % 24), age_s)


@pytest.mark.parametrize("seed", range(5))
def test_whatever_happens_to_the_tree_the_result_is_that_of_its_contents(
    seed: int, tmp_path: pathlib.Path
) -> None:
    draw = random.Random(seed)
    root, out = tmp_path / "logs", tmp_path / "out"
    put(root / "m1/2026-11-20.log", text("2026-11-20"))
    for step in range(12):
        happen(draw, root, step)
        if step % 3 == 2:
            outcome = run(root, out)
    run(root, tmp_path / "fresh")
    assert results(out) == results(tmp_path / "fresh")
    own = lines(out)
    files = [path for path in root.rglob("*") if path.is_file()]
    assert sorted(own) == sorted(f"{path.parent.name}/{path.name}" for path in files)
    contents = {}
    for line in own.values():
        if line["status"] in ("counted", "incomplete"):
            assert contents.setdefault(line["blake3"], line["frames"]) == line["frames"]
    counted = [line for line in own.values() if line["status"] in ("counted", "incomplete")]
    assert len(counted) == len(contents) == outcome.logs
    assert frames_counted(out) == sum(contents.values())
    assert all(line["sentence"] for line in own.values() if line["status"] != "counted")


def test_days_merged_in_any_order_and_grouping_give_the_same_bytes(
    logs: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    how = work.How()
    parts = []
    for path in sorted(logs.rglob("*.log")):
        [read] = work.read_all([layout.Log(str(path), "m", None, 0, "", True)], how)
        assert read.summary is not None
        parts.append((read.summary, path.name))
    [whole] = work.join([work.Day("m", "2026-11-20", tuple(parts))])
    draw = random.Random(7)
    for _ in range(10):
        draw.shuffle(parts)
        [one] = work.join([work.Day("m", "2026-11-20", tuple(parts))])
        assert one == whole
        cut = draw.randint(1, len(parts) - 1)
        halves = work.join([work.Day("m", "d", tuple(half)) for half in (parts[:cut], parts[cut:])])
        merged = plumb.merge(work.unpack(half.summary) for half in halves)
        assert merged == work.unpack(whole.summary)


@pytest.mark.parametrize(
    ("path_day", "first", "last", "day", "is_noted"),
    [
        ("2026-11-20", "2026-11-20T08", "2026-11-20T09", "2026-11-20", False),
        ("2026-11-20", "2026-11-19T13", "2026-11-20T13", "2026-11-20", False),
        ("2026-11-20", "2026-11-21T05", "2026-11-21T10", "2026-11-20", False),
        ("2026-11-20", "2026-11-23T00", "2026-11-23T01", "2026-11-23", True),
        ("2026-11-20", "2031-01-05T00", "2031-01-05T00", "2031-01-05", True),
        (None, "2026-11-22T23", "2026-11-23T01", "2026-11-22", False),
        ("2026-11-20", None, None, "2026-11-20", False),
        (None, None, None, None, True),
    ],
)
def test_a_log_counts_on_the_day_of_its_path_unless_its_frames_are_of_another(
    path_day: str | None, first: str | None, last: str | None, day: str | None, is_noted: bool
) -> None:
    import datetime

    def ns(when: str | None) -> int | None:
        if when is None:
            return None
        at = datetime.datetime.strptime(when, "%Y-%m-%dT%H").replace(tzinfo=datetime.timezone.utc)
        return int(at.timestamp()) * 10**9

    log = layout.Log("/l/m/x.log", "m", path_day, 1, "1", True)
    read = work.Read("0" * 64, True, 5, ns(first), ns(last))
    line, part = filing.filed(filing.Entry(log, read), None, None, "key")
    assert line is not None and line.day == day and (line.sentence is not None) == is_noted
    assert (None if part is None else part.day) == day


def test_what_is_gone_still_counts_and_what_was_moved_counts_once(tmp_path: pathlib.Path) -> None:
    root, out = tree(tmp_path / "logs", 2, 2), tmp_path / "out"
    before = run(root, out)
    (root / "m1/2026-11-20.log").unlink()
    (root / "m2/2026-11-20.log").rename(root / "m2/2026-11-20 moved.log")
    after = run(root, out)
    assert (after.logs, after.frames) == (before.logs, before.frames)
    assert not after.notes and "m2/2026-11-20.log" not in lines(out)


def test_figures_of_other_nodes_stayed_when_a_run_was_repeated_with_new_nodes(
    tmp_path: pathlib.Path,
) -> None:
    root, out = tree(tmp_path / "logs", 2, 2), tmp_path / "out"
    run(root, out)
    for nodes in ([7, 9], []):
        run(root, out, nodes=nodes)
        run(root, tmp_path / f"fresh {nodes}", nodes=nodes)
        assert results(out) == results(tmp_path / f"fresh {nodes}")
    assert results(tmp_path / "fresh []") != results(tmp_path / "fresh [7, 9]")


def test_a_log_that_was_gone_was_forgotten_silently_when_other_nodes_were_given(
    tmp_path: pathlib.Path,
) -> None:
    root, out = tree(tmp_path / "logs", 1, 3), tmp_path / "out"
    run(root, out)
    gone = root / "m1/2026-11-20.log"
    gone.unlink()
    (root / "m1/2026-11-21.log").rename(root / "m1/2026-11-21 moved.log")
    outcome = run(root, out, nodes=[7, 9])
    sentence = f"{gone} is gone, and was read with other --nodes or --eds: it no longer counts"
    assert outcome.failed == {str(gone): sentence} and outcome.logs == 2


@pytest.mark.parametrize("nodes", [[], [7, 9]])
def test_a_log_that_was_compressed_in_place_counted_twice(
    nodes: list[int], tmp_path: pathlib.Path
) -> None:
    root, out = tree(tmp_path / "logs", 1, 3), tmp_path / "out"
    before = run(root, out)
    for name in ("2026-11-20.log", "2026-11-21.log"):
        log = root / "m1" / name
        put(root / "m1" / f"{name}.gz", gzip.compress(log.read_bytes(), mtime=0))
        log.unlink()
    outcome = run(root, out, nodes=nodes)
    assert (outcome.logs, outcome.frames, outcome.failed) == (before.logs, before.frames, {})
    assert sorted(lines(out)) == [f"m1/2026-11-2{n}" for n in ("0.log.gz", "1.log.gz", "2.log")]
    run(root, tmp_path / "fresh", nodes=nodes)
    assert results(out) == results(tmp_path / "fresh")
    # The archive takes the compressed log, too, and the log comes back as it was.
    (root / "m1/2026-11-20.log.gz").unlink()
    put(root / "m1/2026-11-20 again.log", text("2026-11-20"))
    again = run(root, out, nodes=nodes)
    assert (again.logs, again.frames, again.failed) == (before.logs, before.frames, {})


def test_a_folder_in_which_a_compressed_log_counted_twice_is_put_right(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, out = tree(tmp_path / "logs", 1, 2), tmp_path / "out"
    before = run(root, out)
    log = root / "m1/2026-11-20.log"
    put(root / "m1/2026-11-20.log.gz", gzip.compress(log.read_bytes(), mtime=0))
    log.unlink()
    monkeypatch.setattr(work, "contents", lambda logs: [work.Content(None) for _ in logs])
    monkeypatch.setattr(scratch.Scratch, "successor", lambda *_: None)
    assert run(root, out).frames > before.frames
    monkeypatch.undo()
    outcome = run(root, out)
    assert (outcome.read, outcome.logs, outcome.frames) == (0, before.logs, before.frames)


def test_logs_with_frames_of_the_same_time_and_other_contents_count_each(
    tmp_path: pathlib.Path,
) -> None:
    for machine, data in (("m1", b"00"), ("m2", b"01"), ("m3", b"02")):
        content = b"(1795168800.000000) can0 123#%s\n" % data * 3
        packed = gzip.compress(content, mtime=0)
        cut = packed[:-5] if machine == "m3" else packed
        put(tmp_path / "logs" / machine / "2026-11-20.log", content if machine == "m1" else cut)
    outcome = run(tmp_path / "logs", tmp_path / "out")
    assert (outcome.machines, outcome.logs) == (3, 3)


def no_such_day(root: pathlib.Path) -> None:
    put(root / "m1/2024-02-30.log", text("2026-11-20"))


def link_to_nowhere(root: pathlib.Path) -> None:
    (root / "m1/2026-11-22.log").symlink_to(root / "nowhere")


def folder_that_is_not_utf8(root: pathlib.Path) -> None:
    folder = os.fsencode(root / "m") + b"\xff"
    os.mkdir(folder)
    with open(folder + b"/2026-11-22.log", "w") as file:
        file.write(text("2026-11-22"))


@pytest.mark.parametrize("prepare", [no_such_day, link_to_nowhere, folder_that_is_not_utf8])
def test_a_log_that_was_not_read_left_the_report_clean_and_the_status_0(
    prepare: Callable[[pathlib.Path], None], tmp_path: pathlib.Path
) -> None:
    root, out = tmp_path / "logs", tmp_path / "out"
    put(root / "m1/2026-11-20.log", text("2026-11-20"))
    put(root / "readme.txt", "of no machine")
    assert main([str(root), str(out)]) == 0
    assert json.loads((out / "report.json").read_text())["clean"]
    prepare(root)
    assert main([str(root), str(out)]) == 2
    report = json.loads((out / "report.json").read_text())
    assert not report["clean"] and "1 log could not be read" in report["verdict"]


def test_a_folder_that_can_not_be_listed_was_left_out_silently(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, scandir = tree(tmp_path / "logs", 2, 1), os.scandir

    def refuse(folder: str) -> object:
        if str(folder).endswith("m2"):
            raise PermissionError(13, "Permission denied", folder)
        return scandir(folder)

    monkeypatch.setattr(layout.os, "scandir", refuse)
    outcome = run(root, tmp_path / "out")
    assert outcome.failed == {str(root / "m2"): "the folder can't be listed: Permission denied"}


@pytest.mark.parametrize(
    ("row", "sentence"),
    [
        ({"path": "gone.log", "machine": "m"}, "it can't be read: No such file or directory"),
        ({"path": "a.log", "machine": "m", "day": "x"}, "the manifest's day 'x' is no day"),
    ],
)
def test_a_row_of_a_manifest_that_was_not_read_left_the_status_0(
    row: dict[str, str],
    sentence: str,
    tmp_path: pathlib.Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    put(tmp_path / "logs/a.log", text("2026-11-20"))
    put(tmp_path / "logs/b.log", text("2026-11-21"))
    rows = [{"path": "b.log", "machine": "m", "day": None}, {"day": None} | row]
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist(rows), tmp_path / "m.parquet")
    words = [str(tmp_path / "logs"), str(tmp_path / "out")]
    assert main([*words, "--manifest", str(tmp_path / "m.parquet")]) == 2
    [line] = [line for line in capsys.readouterr().out.splitlines() if sentence in line]
    assert line.startswith(f"  {tmp_path / 'logs' / row['path']}: ")


def test_the_section_of_warnings_and_faults_per_hour_had_incidents_alone(
    tmp_path: pathlib.Path,
) -> None:
    out = tmp_path / "out"
    put(tmp_path / "logs/m/2026-11-20.log", text("2026-11-20", 1, "+1 s fault b stuck"))
    run(tmp_path / "logs", out)
    report = json.loads((out / "report.json").read_text())
    title = "Warnings and faults per hour"
    [section] = [one for one in report["sections"] if one["title"] == title]
    [by_machine] = [table for table in section["tables"] if table["title"] == "By machine"]
    names = [column["name"] for column in by_machine["columns"]]
    [asked] = [row for row in query(out, "faults").to_pylist() if row["grouped_by"] == "machine"]
    [shown] = by_machine["rows"]
    assert asked["faults_per_hour"] > 0
    for kind in ("warnings", "faults", "incidents"):
        cell = shown[names.index(f"{kind.capitalize()} per hour")]
        assert cell == f"{asked[f'{kind}_per_hour']:.3f}"


class Pooled:
    """A scheduler as a script may have it."""

    def map(self, function: schedulers.Function, jobs: Iterable, *more: object) -> Iterator:
        for group in schedulers.groups(jobs):
            yield group, function(group, *more)


class OfItems:
    """One whose `map` takes a function of one item."""

    def map(self, function: schedulers.Function, items: Iterable) -> Iterator:
        return map(function, items)


class OfResults:
    """One that gives results without their jobs."""

    def map(self, function: schedulers.Function, jobs: Iterable, *more: object) -> Iterator:
        yield from ([] for _ in jobs)


def test_a_scheduler_of_ones_own_that_is_none_ended_in_a_type_error(tmp_path: pathlib.Path) -> None:
    root = tree(tmp_path / "logs", 1, 2)
    assert run(root, tmp_path / "out", scheduler=Pooled()).logs == 2
    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        for wrong in (OfItems(), OfResults(), pool, object()):
            with pytest.raises(FleetError, match="^the scheduler needs a map.function, jobs, "):
                run(root, tmp_path / "none", scheduler=wrong)  # type: ignore[arg-type]


def test_a_copy_on_another_machine_is_listed_and_counts_once(tmp_path: pathlib.Path) -> None:
    for name in ("m1", "m2"):
        put(tmp_path / "logs" / name / "2026-11-20.log", text("2026-11-20"))
    outcome = run(tmp_path / "logs", tmp_path / "out")
    [(log, sentence)] = outcome.notes.items()
    assert log.endswith("m2/2026-11-20.log") and "m1/2026-11-20.log: counted once" in sentence
    assert (outcome.machines, outcome.logs, outcome.frames) == (1, 1, len(frames(1)))


def test_the_same_machine_in_two_folders_is_one(tmp_path: pathlib.Path) -> None:
    put(tmp_path / "logs/north/m1/2026-11-20.log", text("2026-11-20", hour=6))
    put(tmp_path / "logs/south/m1/20261120_b.log", text("2026-11-20", hour=9))
    outcome = run(tmp_path / "logs", tmp_path / "out", pattern="*/{machine}/{day}*")
    assert (outcome.machines, outcome.logs) == (1, 2)
    assert query(tmp_path / "out", "from figures").num_rows == 1


def test_a_bucket_gives_the_bytes_of_a_folder(logs: pathlib.Path, tmp_path: pathlib.Path) -> None:
    bucket = fsspec.filesystem("memory")
    bucket.rm("/bucket", recursive=True) if bucket.exists("/bucket") else None
    bucket.put(str(logs), "/bucket", recursive=True)
    outcome = run("memory://bucket", tmp_path / "bucket")
    assert outcome.logs == 12
    run(logs, tmp_path / "folder")
    assert results(tmp_path / "bucket") == results(tmp_path / "folder")
    assert run("memory://bucket", tmp_path / "bucket").read == 0


def test_a_manifest_names_logs_and_machines(tmp_path: pathlib.Path) -> None:
    put(tmp_path / "logs/a b.log", text("2026-11-20"))
    put(tmp_path / "logs/x/y.log", text("2026-11-21", 2))
    rows = [
        {"path": "a b.log", "machine": "M/1", "model": "crane", "calibration_due": "2026-01-01"},
        {"path": str(tmp_path / "logs/x/y.log"), "machine": "M 2", "model": None},
        {"path": "not there.log", "machine": "M 2", "model": "truck"},
        # It ended the run: of another kind than what is installed here.
        {"path": "nothing://bucket/z.log", "machine": "M 2", "model": "truck"},
    ]
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist(rows), tmp_path / "m.parquet")
    outcome = run(tmp_path / "logs", tmp_path / "out", manifest=tmp_path / "m.parquet")
    assert (outcome.machines, outcome.logs) == (2, 2)
    assert [key.split("/")[-1] for key in sorted(outcome.failed)] == ["not there.log", "z.log"]
    assert "of a kind that is not installed" in outcome.failed["nothing://bucket/z.log"]
    assert outcome.visits == ["M/1"]
    page = outcome.page.read_text()
    assert 'href="machines/M%252F1/report.html"' in page and "due on 2026-01-01" in page
    assert (tmp_path / "out/machines/M%2F1/report.html").exists()
    models = query(tmp_path / "out", "select machine, model from machine_days order by machine")
    assert models.to_pylist() == [
        {"machine": "M 2", "model": "truck"},
        {"machine": "M/1", "model": "crane"},
    ]


def test_a_path_that_a_manifest_lists_twice_was_called_a_copy_of_itself(
    tmp_path: pathlib.Path,
) -> None:
    put(tmp_path / "logs/a.log", text("2026-11-20"))
    put(tmp_path / "logs/b.log", text("2026-11-21"))
    rows = [{"path": name, "machine": machine} for name, machine in
            [("a.log", "m1"), ("b.log", "m1"), ("a.log", "m1"), ("b.log", "m2")]]
    manifest, out = tmp_path / "m.parquet", tmp_path / "out"
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist(rows), manifest)
    outcome = run(tmp_path / "logs", out, manifest=manifest)
    said = "the manifest lists it twice: counted once"
    assert list(outcome.notes.values()) == [said, f"{said}, for m1"]
    assert (outcome.logs, outcome.read, outcome.machines) == (2, 2, 1)
    assert [line["status"] for line in lines(out).values()] == ["counted", "counted"]
    # The line of the copy hid that the log counts: once gone, it was lost.
    (tmp_path / "logs/a.log").unlink()
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist(rows[1:2]), manifest)
    assert run(tmp_path / "logs", out, manifest=manifest).frames == outcome.frames


@pytest.mark.parametrize("name", ["machine", "path", "model"])
@pytest.mark.parametrize("is_bytes", [True, False])
def test_bytes_in_a_manifest_that_are_no_text_ended_in_a_traceback(
    name: str, is_bytes: bool, tmp_path: pathlib.Path
) -> None:
    put(tmp_path / "logs/a.log", text("2026-11-20"))
    row = {"path": b"a.log", "machine": b"m\xc3\xbc", "model": b"crane"}
    kind = pyarrow.binary() if is_bytes else pyarrow.string()

    def write(row: dict[str, bytes]) -> None:
        columns = {key: pyarrow.array([value]).view(kind) for key, value in row.items()}
        pyarrow.parquet.write_table(pyarrow.table(columns), tmp_path / "m.parquet")

    write(row | {name: b"\xff\xfe"})
    with pytest.raises(FleetError, match=f"has a {name} that is not UTF-8: write it as text$"):
        run(tmp_path / "logs", tmp_path / "out", manifest=tmp_path / "m.parquet")
    write(row)
    run(tmp_path / "logs", tmp_path / "out", manifest=tmp_path / "m.parquet")
    assert lines(tmp_path / "out")["logs/a.log"]["machine"] == "mü"


@pytest.mark.parametrize(
    "name",
    [
        ".lock/x",
        ".journal/x",
        "logs.parquet/x",
        "machines.parquet/x",
        "report.html/x",
        "report.json/x",
        "figures/2026-11-20/rows.parquet/x",
        "figures/day=2026-11-20/rows.parquet/x",
        "logs",
        "figures",
        "summaries",
        "machines",
        "figures/2026-11-20",
        "summaries/2026-11-20",
        "summaries/2026-11-01",
        "figures/day=2026-11-20",
        "summaries/day=2026-11-20",
        "summaries/day=2026-11-01",
        "logs/{key}",
        "logs/{key}/{ab}",
        "logs/{key}/{ab}/{blake3}/x",
        "machines/m1",
    ],
)
def test_a_file_or_folder_of_the_wrong_kind_in_the_results_ended_in_a_traceback(
    name: str, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(tmp_path / "logs/m1/2026-11-20.log", text("2026-11-20", 1, "+1 s fault b stuck"))
    assert run(tmp_path / "logs", tmp_path / "good").visits == ["m1"]
    [line] = lines(tmp_path / "good").values()
    blake3 = line["blake3"]
    name = name.format(key=line["key"], ab=blake3[:2], blake3=blake3)
    if name != ".lock/x":
        put(tmp_path / "out/.lock", "")
    wrong = put(tmp_path / "out" / name, "a person's own")
    assert main([str(tmp_path / "logs"), str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err.splitlines()
    place = wrong.parent if name.endswith("/x") else wrong
    assert len(said) == 1 and str(place) in said[0], said
    assert wrong.read_text() == "a person's own"


def test_a_log_is_hashed_whole_however_much_of_it_is_read(tmp_path: pathlib.Path) -> None:
    whole = text("2026-11-20").encode()
    packed = gzip.compress(whole, mtime=0)
    contents = [whole, whole[:-9], packed, packed[:-9], packed + b"x", packed + b"y", b"", b"abc"]
    hashes = []
    for content in contents:
        path = put(tmp_path / "m.log", content)
        counted = _plumb.count(str(path), [], [])
        hashes.append(counted.blake3)
        if counted.error is None:
            assert (counted.summary, counted.incomplete) == _plumb.summarise([str(path)], [], [])
    assert len(set(hashes)) == len(contents)
    # Those of the empty file and of "abc" are known.
    assert hashes[-2:] == [
        "af1349b9f5f9a1a6a0404dea36dcc9499bcb25c9adc112b7cc9a93cae41f3262",
        "6437b3ac38465133ffb63b75273a8db548c558465d79db03fd359c6cd5bd9d85",
    ]


def test_a_log_that_is_written_while_it_is_read_is_left_for_the_next_run(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = put(tmp_path / "logs/m/2026-11-20.log", text("2026-11-20"))
    put(tmp_path / "logs/m/2026-11-21.log", text("2026-11-21"))
    counted = work._count

    def count_and_append(name: str, how: work.How) -> dict:
        found = counted(name, how)
        if name == str(path):
            with path.open("a") as file:
                file.write("(1.0) can0 080#\n")
        return found

    monkeypatch.setattr(work, "_count", count_and_append)
    outcome = run(tmp_path / "logs", tmp_path / "out")
    assert list(outcome.failed) == [str(path)] and outcome.logs == 1
    assert outcome.failed[str(path)] == f"{path} is being written: the next run counts it"
    monkeypatch.undo()
    assert run(tmp_path / "logs", tmp_path / "out").logs == 2


def test_a_kept_summary_that_is_damaged_or_of_another_version_is_made_anew(
    tmp_path: pathlib.Path,
) -> None:
    root, out = tree(tmp_path / "logs", 2, 2), tmp_path / "out"
    run(root, out)
    before = results(out)
    kept = [path for path in (out / "logs").rglob("*") if path.is_file()]
    assert json.loads(plumb.summarise(root / "m1/2026-11-20.log"))["version"] == store.VERSION
    head, _, summary = kept[0].read_bytes().partition(b"\n")
    # Without its check sum, as earlier versions have written it.
    fields = json.loads(head)
    del fields["crc32"]
    kept[0].write_bytes(json.dumps(fields | {"version": 7}).encode() + b"\n" + summary)
    kept[1].write_bytes(b"{}")
    kept[2].write_bytes(kept[2].read_bytes().replace(b'"frames": ', b'"frames": 1'))
    head, _, summary = kept[3].read_bytes().partition(b"\n")
    fields = json.loads(head)
    del fields["crc32"]
    kept[3].write_bytes(json.dumps(fields).encode() + b"\n" + summary)
    outcome = run(root, out)
    assert outcome.read == 3 and results(out) == before


def damage(out: pathlib.Path, log: pathlib.Path, left: int = -20) -> None:
    """Cuts the summary of a log, and removes the figures, so that it is needed."""
    place = store.Store(out, work.How().key)._place(_plumb.count(str(log), [], []).blake3)
    place.write_bytes(place.read_bytes()[:left])
    for path in (out / "figures").rglob("*.parquet"):
        path.unlink()


def test_a_log_whose_summary_was_cut_is_counted_again_in_the_same_run(
    tmp_path: pathlib.Path,
) -> None:
    root, out = tree(tmp_path / "logs", 1, 2), tmp_path / "out"
    run(root, out)
    before = results(out)
    damage(out, root / "m1/2026-11-20.log")
    outcome = run(root, out)
    assert (outcome.read, outcome.skipped, outcome.failed) == (1, 1, {})
    assert results(out) == before and run(root, out).read == 0


@pytest.mark.parametrize("left", [-20, 0])
def test_a_log_that_is_gone_and_whose_summary_is_damaged_is_listed(
    left: int, tmp_path: pathlib.Path
) -> None:
    root, out = tree(tmp_path / "logs", 1, 3), tmp_path / "out"
    run(root, out)
    log = root / "m1/2026-11-20.log"
    damage(out, log, left)
    log.unlink()
    outcome = run(root, out)
    sentence = f"{log} is gone, and its summary is damaged: it no longer counts"
    assert outcome.failed == {str(log): sentence} and outcome.logs == 2
    assert not run(root, out).failed


def test_a_folder_of_another_format_is_refused_and_left_as_it_is(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, out = tree(tmp_path / "logs", 1, 2), tmp_path / "out"
    monkeypatch.setattr(store, "FORMAT", "1")
    run(root, out)
    before = results(out) | {"logs": (out / "logs.parquet").read_bytes()}
    monkeypatch.undo()
    sentence = "logs.parquet is of format 1, and format 2 is read: count the logs into a new folder"
    with pytest.raises(FleetError, match=sentence):
        run(root, out)
    assert results(out) | {"logs": (out / "logs.parquet").read_bytes()} == before
    with pytest.raises(FleetError, match="is of format 1, and format 2 is read"):
        query(out, "faults")


def test_a_folder_of_results_that_is_not_utf_8_ended_in_a_traceback(tmp_path: pathlib.Path) -> None:
    out = os.fsdecode(os.fsencode(tmp_path / "out") + b"\xff")
    with pytest.raises(FleetError, match=r"out\\udcff is not UTF-8: give the results a folder"):
        run(tree(tmp_path / "logs", 1, 1), out)
    assert not os.path.exists(out)


def test_odd_names_and_files_that_are_none_stop_nothing(tmp_path: pathlib.Path) -> None:
    root, long = tmp_path / "logs", "ö" * 120
    put(root / "m1/2026-11-20.log", text("2026-11-20"))
    for name in (long, "con.", "  ", "a\nb\x1b[31m", "..."):
        put(root / name / "2026-11-20.log", text("2026-11-20", 2, hour=len(name) % 23))
    for name in ("2026-11-21.log", "2026-11-22.log"):
        (root / "m1" / name).symlink_to(tmp_path / "nowhere")
    os.mkfifo(root / "m1/2026-11-23.log")
    with open(os.fsencode(root / "m1/2026-11-24") + b"\xff.log", "w") as file:
        file.write(text("2026-11-24"))
    manifest = [{"path": str(path), "machine": path.parent.name, "calibration_due": "2000-01-01"}
                for path in root.rglob("2026-11-20.log")]
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist(manifest), tmp_path / "m.parquet")
    outcome = run(root, tmp_path / "all", pattern="{machine}/{day}*")
    # A name that begins with a dot is hidden: "...".
    assert outcome.logs == 5 and len(outcome.failed) == 4 and not outcome.notes
    assert sum("is no file" in why for why in outcome.failed.values()) == 3
    assert sum("is not UTF-8" in why for why in outcome.failed.values()) == 1
    outcome = run(root, tmp_path / "out", manifest=tmp_path / "m.parquet")
    assert outcome.logs == 6
    folders = list((tmp_path / "out/machines").iterdir())
    assert len(folders) == len(outcome.visits) == outcome.machines


def test_a_bar_tells_the_time_left() -> None:
    assert left(0, 10, 5) == "" and left(5, 10, 60) == "1 min 00 s left"
    assert left(1, 3, 3600) == "2 h 00 min left"
    bar = Bar()
    line = bar.line(3, 4, 30, 40, 6.0)
    assert line.endswith("3 of 4, 2 s left") and line.count("#") == 22
