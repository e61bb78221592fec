"""A fleet on a Dask scheduler with two worker processes: the bytes of one process, also when a
worker is killed; and what can't be done ends in one sentence, with nothing written."""

from __future__ import annotations

import contextlib
import json
import os
import pathlib
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import psutil
import pyarrow
import pyarrow.parquet
import pytest
from conftest import ROOT
from distributed import Client
from distributed.deploy.subprocess import SubprocessCluster
from fleets import put, results, text, tree

from plumb.fleet import FleetError, run, schedulers, store, work
from plumb.fleet.__main__ import main


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    return tree(tmp_path_factory.mktemp("fleet") / "logs", 3, 4)


@pytest.fixture(scope="module")
def wanted(logs: pathlib.Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What one process makes of the logs."""
    out = tmp_path_factory.mktemp("one") / "out"
    run(logs, out, workers=1)
    return results(out)


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """A scheduler and two worker processes, which are started again when they are lost."""
    os.environ["DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES"] = "1"
    cluster = SubprocessCluster(
        host="127.0.0.1",
        n_workers=2,
        threads_per_worker=1,
        scheduler_kwargs={"dashboard": False},
        worker_kwargs={"dashboard": False, "memory_limit": 0},
    )
    del os.environ["DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES"]
    with Client(cluster.scheduler_address, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=120)
        yield cluster.scheduler_address
    cluster.close()


def pids(address: str) -> set[int]:
    with Client(address, set_as_default=False) as client:
        return set(client.run(os.getpid).values())


def test_two_workers_give_the_bytes_of_one_process(
    scheduler: str, logs: pathlib.Path, wanted: dict[str, bytes], tmp_path: pathlib.Path
) -> None:
    outcome = run(logs, tmp_path / "out", scheduler=scheduler)
    assert outcome.read == 12 and results(tmp_path / "out") == wanted
    assert run(logs, tmp_path / "out", scheduler=scheduler).skipped == 12


def test_a_worker_that_is_killed_loses_nothing_and_counts_nothing_twice(
    scheduler: str,
    logs: pathlib.Path,
    wanted: dict[str, bytes],
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(schedulers, "GROUP", 1)
    before = pids(scheduler)
    victim = min(before)

    def kill(stage: str, jobs: int, *_: float) -> None:
        if stage == "reading" and jobs == 2:
            os.kill(victim, signal.SIGKILL)

    outcome = run(logs, tmp_path / "out", scheduler=scheduler, progress=kill)
    assert (outcome.read, outcome.logs) == (12, 12) and not outcome.failed
    assert results(tmp_path / "out") == wanted
    assert victim not in pids(scheduler)


def test_a_job_that_ends_its_worker_each_time_is_told_and_the_others_are_done(
    scheduler: str,
) -> None:
    def end(jobs: list[int]) -> list[int]:
        if 13 in jobs:
            os._exit(1)
        return jobs

    with schedulers.opened(scheduler, 1) as place:
        done = {}
        for group, outcome in place.map(end, ((number, 1) for number in (12, 13, 14))):
            done |= dict.fromkeys(group, outcome)
    assert sorted(done) == [12, 13, 14] and [done[12], done[14]] == [[12], [14]]
    assert "its worker was lost each time" in str(done[13])


def test_processes_of_this_machine_are_used_without_set_up(
    logs: pathlib.Path, wanted: dict[str, bytes], tmp_path: pathlib.Path
) -> None:
    run(logs, tmp_path / "out", workers=2)
    assert results(tmp_path / "out") == wanted


@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGKILL, signal.SIGINT])
def test_a_run_that_was_terminated_or_killed_left_its_processes_running(
    ending: signal.Signals, logs: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    script = """
import signal, sys
from plumb.fleet import __main__, runs

# A shell starts what it puts into the background with this signal left aside.
signal.signal(signal.SIGINT, signal.default_int_handler)
runs._read = lambda *words: (print("ready", flush=True), input())
sys.exit(__main__.main([*sys.argv[1:], "--workers", "2"]))
"""
    command = [sys.executable, "-c", script, str(logs), str(tmp_path / "out")]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None and process.stdout.readline() == b"ready\n"
    started = psutil.Process(process.pid).children(recursive=True)
    assert len(started) >= 5
    process.send_signal(ending)
    _, alive = psutil.wait_procs(started, timeout=60)
    assert not alive
    said = process.communicate(timeout=60)[1].decode()
    if ending is not signal.SIGKILL:
        assert process.returncode == 130
        assert said == "plumb.fleet: interrupted: what is finished is kept, run again\n"


def no_log(root: pathlib.Path) -> None:
    put(root / "logs/m1/2026-11-20.log", b"no log\n" * 40)


def no_manifest(root: pathlib.Path) -> None:
    put(root / "logs/m1/2026-11-20.log", text("2026-11-20"))
    pyarrow.parquet.write_table(pyarrow.table({"path": ["m1/x"]}), root / "m.parquet")
    gone = pyarrow.table({"path": ["m1/x"], "machine": ["m1"]})
    pyarrow.parquet.write_table(gone, root / "gone.parquet")
    put(root / "junk.parquet", b"PAR1 junk")


def test_data_sheets_without_a_node_were_refused_after_all_logs_were_read(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, reads = tree(tmp_path / "logs", 1, 2), []
    monkeypatch.setattr(work, "read", lambda *words: reads.append(words))
    with pytest.raises(FleetError, match="does not name its node; write eds .*plumb-a.eds@NODE"):
        run(root, tmp_path / "out", eds=[str(SHEET)])
    assert not reads and not (tmp_path / "out").exists()


@pytest.mark.parametrize("out", ["s3://bucket/out", "file:///tmp/out", "memory://out"])
def test_a_url_of_the_results_made_a_folder_of_its_scheme(
    out: str,
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    root = tree(tmp_path / "logs", 1, 1)
    assert main([str(root), out]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f"plumb.fleet: {out} is a URL, and results are written to a folder")
    assert os.listdir(tmp_path) == ["logs"]


SHEET = ROOT / "eds/plumb-a.eds"

BAD = [
    (["{root}/logs"], None, "holds no file: name the folder of the machines"),
    (["{root}/nowhere"], None, "is not there"),
    (["{root}/logs/m1/2026-11-20.log"], no_log, "is a file"),
    (["{root}/logs"], no_log, "no log could be counted: {root}/logs/m1/2026-11-20.log is no log"),
    (["{root}/logs", "--pattern", "{{day}}/*"], no_log, "has no {{machine}}"),
    (["{root}/logs", "--pattern", "{{machine}}.log"], no_log, "give another --pattern"),
    (["{root}/logs", "--manifest", "{root}/m.parquet"], no_manifest, "has no column machine"),
    (["{root}/logs", "--manifest", "{root}/junk.parquet"], no_manifest, "can't be read as Parquet"),
    (["{root}/logs", "--manifest", "{root}/none.parquet"], no_manifest, "can't be read as Parquet"),
    (["{root}/logs", "--scheduler", "tcp://127.0.0.1:9"], no_manifest, "no Dask scheduler answers"),
    (["{root}/logs", "--scheduler", "nonsense"], no_manifest, "is no address of a Dask"),
    (["{root}/logs", "--scheduler", ""], no_manifest, "'' is no address of a Dask"),
    (["{root}/logs", "--workers", "0"], no_manifest, "0 workers"),
    (["{root}/logs", "--workers", "99999999999"], no_manifest, "are more than one machine takes"),
    (["{root}/logs", "--nodes", "one"], no_manifest, "is no list of node-ids"),
    (["{root}/logs", "--nodes", "1"], no_manifest, "each instrument has two nodes"),
    (["{root}/logs", "--nodes", "1,200"], no_manifest, "200 is no node-id: give 1 to 127"),
    (["{root}/logs", "--band", "nan"], no_manifest, "nan deg is no band"),
    (["{root}/logs", "--band", "-1"], no_manifest, "-1.0 deg is no band"),
    (["{root}/logs", "--eds", "{root}/none.eds@1"], no_manifest, "none.eds can't be read"),
    (["{root}/logs", "--eds", "{root}/m.parquet@1"], no_manifest, "m.parquet"),
    (["{root}/logs", "--eds", str(SHEET)], no_manifest, "plumb-a.eds does not name its node"),
    (["{root}/logs", "--eds", f"{SHEET}@700"], no_manifest, "700 is no node-id"),
    (["{root}/logs", "--manifest", "{root}/gone.parquet"], no_manifest, "there is no log to count"),
    (["{root}/logs", "--today", "soon"], no_manifest, "soon is no day such as 2026-11-20"),
    (["nothing://bucket"], None, "is of a kind that is not installed"),
]


@pytest.mark.parametrize(("words", "prepare", "sentence"), BAD)
def test_what_can_not_be_done_is_one_sentence_and_nothing_is_written(
    words: list[str],
    prepare: object,
    sentence: str,
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(schedulers, "ANSWER_S", 1.0)
    (tmp_path / "logs").mkdir()
    if callable(prepare):
        prepare(tmp_path)
    given = [word.format(root=tmp_path) for word in words]
    before = sorted(tmp_path.rglob("*"))
    status = main([given[0], str(tmp_path / "out"), *given[1:]])
    said = capfd.readouterr()
    assert status == 2 and said.out == ""
    [line] = said.err.splitlines()
    assert line.startswith("plumb.fleet: ") and sentence.format(root=tmp_path) in line
    there = [path for path in sorted(tmp_path.rglob("*")) if "logs" not in path.parts[-3:]]
    assert not [path for path in there if path.name in ("report.html", "rows.parquet")]
    if "could be counted" not in sentence:
        assert sorted(tmp_path.rglob("*")) == before


def test_a_scheduler_that_listens_and_never_answers_is_told(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(schedulers, "ANSWER_S", 1.0)
    root = tree(tmp_path / "logs", 1, 1)
    with socket.create_server(("127.0.0.1", 0)) as mute:
        address = f"tcp://127.0.0.1:{mute.getsockname()[1]}"
        with pytest.raises(FleetError, match=f"no Dask scheduler answers at {address}: start one"):
            run(root, tmp_path / "out", scheduler=address)
    assert not (tmp_path / "out").exists()


def test_a_host_that_answers_in_http_ended_in_a_traceback(
    tmp_path: pathlib.Path, capfd: pytest.CaptureFixture[str]
) -> None:
    root = tree(tmp_path / "logs", 1, 1)
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            for _ in range(2):
                with contextlib.suppress(OSError), server.accept()[0] as client:
                    client.sendall(b"HTTP/1.1 400 Bad Request\r\nConnection: close\r\n\r\n")

        threading.Thread(target=answer, daemon=True).start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        assert main([str(root), str(tmp_path / "out"), "--scheduler", address]) == 2
    [line] = capfd.readouterr().err.splitlines()
    assert f"no Dask scheduler answers at {address}: start one" in line
    assert not (tmp_path / "out").exists()


class Own:
    """A scheduler of a test's own, and workers, all of which may be killed."""

    def __init__(self, folder: pathlib.Path) -> None:
        file = folder / "scheduler.json"
        options = {"host": "127.0.0.1", "dashboard": False, "scheduler_file": str(file)}
        self.workers: list[subprocess.Popen[bytes]] = []
        self.scheduler = self._start({"cls": "distributed.Scheduler", "opts": options})
        while not file.exists() or not file.read_text().endswith("}"):
            time.sleep(0.05)
        self.address = json.loads(file.read_text())["address"]
        self.start_worker()

    def _start(self, spec: dict, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "dask", "spec", *words, "--spec", json.dumps(spec)]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def start_worker(self) -> None:
        options = {"nthreads": 1, "memory_limit": 0, "dashboard": False}
        spec = {"cls": "distributed.Worker", "opts": options}
        self.workers.append(self._start(spec, self.address))

    def __enter__(self) -> Own:
        return self

    def __exit__(self, *_: object) -> None:
        for process in [*self.workers, self.scheduler]:
            process.kill()
            process.wait()


def test_a_scheduler_that_dies_during_the_run_ended_in_a_traceback(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(schedulers, "GROUP", 1)
    root = tree(tmp_path / "logs", 3, 4)
    with Own(tmp_path) as own:

        def kill(stage: str, jobs: int, *_: float) -> None:
            if stage == "reading" and jobs == 2:
                own.scheduler.kill()

        sentence = f"the scheduler {own.address} was lost .*: run again"
        with pytest.raises(FleetError, match=sentence):
            run(root, tmp_path / "out", scheduler=own.address, progress=kill)
    assert run(root, tmp_path / "out", workers=1).skipped >= 2


def test_a_run_whose_workers_were_all_lost_waited_without_a_word(
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(schedulers, "WORKERLESS_S", 1.0)
    monkeypatch.setattr(schedulers, "GROUP", 1)
    root = tree(tmp_path / "logs", 2, 3)
    said: list[str] = []
    with Own(tmp_path) as own:

        def lose(stage: str, jobs: int, *_: float) -> None:
            if stage == "reading" and jobs == 1:
                own.workers[0].kill()
                threading.Thread(target=return_when_told, daemon=True).start()

        def return_when_told() -> None:
            for _ in range(300):
                said.append(capsys.readouterr().err)
                if "has no worker" in said[-1]:
                    break
                time.sleep(0.1)
            own.start_worker()

        outcome = run(root, tmp_path / "out", scheduler=own.address, progress=lose)
    sentence = f"the scheduler {own.address} has no worker: waiting for one"
    assert "".join(said) == f"plumb.fleet: {sentence}\n"
    assert outcome.logs == 6 and not outcome.failed


def test_bad_logs_among_good_ones_are_listed_and_the_status_is_2(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tree(tmp_path / "logs", 1, 2)
    cut = put(root / "m1/2026-11-22.log", text("2026-11-22")[:-9])
    junk = put(root / "m1/2026-11-23.log", b"\x00\x01" * 500)
    assert main([str(root), str(tmp_path / "out")]) == 2
    said = capsys.readouterr().out
    assert "Not counted: 1\n" in said and f"{junk} is no log of a CAN bus" in said
    assert "Counted in part: 1\n" in said and f"the first in {cut} line" in said
    page = (tmp_path / "out/report.html").read_text()
    assert "is no log of a CAN bus" in page and "2 logs could not be read" in page
    assert main([str(root), str(tmp_path / "out")]) == 2
    assert "0 read now, 4 finished before" in capsys.readouterr().out


def test_two_runs_at_once_on_one_folder_are_refused(tmp_path: pathlib.Path) -> None:
    root, out = tree(tmp_path / "logs", 1, 1), tmp_path / "out"
    with store.owned(out):
        with pytest.raises(FleetError, match="another run writes to"):
            run(root, out)
    assert run(root, out).logs == 1


def test_a_folder_that_can_not_be_made_is_told(tmp_path: pathlib.Path) -> None:
    root = tree(tmp_path / "logs", 1, 1)
    file = put(tmp_path / "file", b"")
    for out in (file, file / "out"):
        with pytest.raises(FleetError, match="cannot make the folder"):
            run(root, out)


def test_results_below_the_logs_are_no_logs(tmp_path: pathlib.Path) -> None:
    root = tree(tmp_path / "logs", 1, 2)
    for _ in range(2):
        outcome = run(root, root / "results of today")
        assert outcome.logs == 2 and not outcome.notes
