"""Measures a fleet and prints the last section of docs/fleet.md, or writes it there.

`cargo xtask fleet` calls it with the package and the program of the one build. In: a folder for
logs, which are made where they are missing. Out: logs and frames per second with one and with two
workers beside the program `plumb report` in the same run, memory, whether all ways give the same
bytes, and how well the visits of a synthetic fleet match its truth. A figure that misses its aim is
printed with the word missed.

Left out: judging the machine it runs on.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import datetime
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pyarrow.parquet
from conftest import PLUMB, candump, shift
from distributed import Client
from fleets import results

from plumb.fleet import QUESTIONS, processes, query, run, schedulers, synthetic, visits

PEAK = """import sys
from plumb.fleet.__main__ import main
status = main(sys.argv[1:])
print(open("/proc/self/status").read())
sys.exit(status)
"""
"""Runs the command line and prints the peak of its own memory: that which the system keeps of a
child has the parent's in it."""

HEADING = "## Measured\n"
BLOCK_S = 60
AIM = 0.9
AIM_KB = 0.2
"""Memory that a log may take, kB."""
LOOK_S = 0.05
"""Time between two looks at the memory of all processes."""
ROUNDS = 3
"""Rounds of all ways; the fastest of each counts, since others may use the machine."""
DAY0 = datetime.datetime(2026, 9, 1, tzinfo=datetime.timezone.utc)


def seconds_of_a_bus() -> list[bytes]:
    """A minute of a machine's bus with a fault, second by second; the seconds stand as XXXXXXXXXX."""
    text = candump(shift(3, BLOCK_S, "+3 s fault b stuck"), 0.0)
    found: dict[int, list[str]] = {}
    for line in text.splitlines(keepends=True):
        whole, _, rest = line[1:].partition(".")
        found.setdefault(int(whole), []).append(f"(XXXXXXXXXX.{rest}")
    return ["".join(found[second]).encode() for second in sorted(found)]


def recording(parts: list[bytes], begins_s: int) -> Iterator[bytes]:
    """The bus again and again, from this time on."""
    now_s = begins_s
    while True:
        for part in parts:
            yield part.replace(b"XXXXXXXXXX", b"%010d" % now_s)
            now_s += 1


def make(path: pathlib.Path, parts: list[bytes], begins_s: int, size: int) -> None:
    """A log of about this size in bytes, unless it is there."""
    if path.exists():
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    written = 0
    with (half := path.with_suffix(".part")).open("wb") as file:
        for part in recording(parts, begins_s):
            written += file.write(part)
            if written >= size:
                break
    half.rename(path)


def make_many(root: pathlib.Path, parts: list[bytes], count: int, size: int, days: int) -> None:
    """So many logs of this size, of so many days for each machine."""
    for number in range(count):
        machine, day = divmod(number, days)
        begins_s = int(DAY0.timestamp()) + 86_400 * day + 3600 + machine % 3600
        date = (DAY0 + datetime.timedelta(day)).date().isoformat()
        make(root / f"machine {machine:04}" / f"{date}.log", parts, begins_s, size)


class Clock:
    """The time of the stage `reading` of a run."""

    def __init__(self, then: Callable[[int], None] = lambda _: None) -> None:
        self.first_s = self.last_s = 0.0
        self._then = then

    def __call__(self, stage: str, jobs: int, *_: float) -> None:
        if stage != "reading":
            return
        self.last_s = time.monotonic()
        self.first_s = self.first_s or self.last_s
        self._then(jobs)

    @property
    def took_s(self) -> float:
        return self.last_s - self.first_s


def binary(logs: list[pathlib.Path], out: pathlib.Path, at_once: int) -> float:
    """Seconds of the program on each log, so many at a time."""

    def report(log: pathlib.Path) -> None:
        words = [PLUMB, "report", str(log), "--out", str(out / log.parent.name / log.name)]
        assert subprocess.run(words, stdout=subprocess.DEVNULL).returncode == 0

    began_s = time.monotonic()
    with concurrent.futures.ThreadPoolExecutor(at_once) as pool:
        list(pool.map(report, logs))
    return time.monotonic() - began_s


def fresh(out: pathlib.Path) -> pathlib.Path:
    shutil.rmtree(out, ignore_errors=True)
    return out


def warm() -> None:
    """Loads the package in a worker, which belongs to its start."""
    import plumb.fleet.work  # noqa: F401


def on_cluster(logs: pathlib.Path, out: pathlib.Path, workers: int, kill: bool = False) -> Clock:
    """A run on a cluster of its own; with `kill` a worker is killed in the middle."""
    with processes.local(workers) as address, Client(address, set_as_default=False) as client:
        client.wait_for_workers(workers, timeout=60)
        victims = sorted(client.run(os.getpid).values())
        count = sum(1 for _ in logs.rglob("*.log"))
        killed: list[int] = []

        def perhaps(jobs: int) -> None:
            if kill and not killed and 3 * jobs >= count:
                killed.append(victims[0])
                os.kill(victims[0], signal.SIGKILL)

        client.run(warm)
        clock = Clock(perhaps)
        outcome = run(logs, fresh(out), scheduler=address, progress=clock)
        assert outcome.logs == count and not outcome.failed and bool(killed) == kill
        return clock


def speed(root: pathlib.Path, out: pathlib.Path, title: str) -> list[str]:
    """One table: the program, one process, one and two workers, a worker killed."""
    logs = sorted(root.rglob("*.log"))
    rounds = [once(root, logs, out) for _ in range(ROUNDS)]
    took = {name: min(one[0][name] for one in rounds) for name in rounds[0][0]}
    same = {name: all(one[1][name] for one in rounds) for name in rounds[0][1]}
    frames = rounds[0][2]
    lines = [f"{title}; {len(logs)} logs, {frames / 1e6:.1f} M frames:", ""]
    lines += ["| way | logs/s | frames/s | of the program's speed | same bytes |"]
    lines += ["|---|---:|---:|---:|---|"]
    for name, seconds in took.items():
        verdict = {True: "yes", False: "NO", None: ""}[same.get(name)]
        lines.append(
            f"| {name} | {len(logs) / seconds:.1f} | {frames / seconds / 1e6:.2f} M | "
            f"{share(name, took)} | {verdict} |"
        )
    return [*lines, ""]


def once(
    root: pathlib.Path, logs: list[pathlib.Path], out: pathlib.Path
) -> tuple[dict[str, float], dict[str, bool], int]:
    """Each way once: its seconds, whether it gave the bytes of one process, and the frames."""
    took = {
        f"`plumb report`, {count} at a time": binary(logs, out / "report", number)
        for number, count in ((1, "one"), (2, "two"))
    }
    clock = Clock()
    frames = run(root, fresh(out / "one"), workers=1, progress=clock).frames
    took["one process"] = clock.took_s
    wanted = results(out / "one")
    same = {}
    for name, workers, kill in [
        ("one worker", 1, False),
        ("two workers", 2, False),
        ("two workers, one killed", 2, True),
    ]:
        took[name] = on_cluster(root, out / "more", workers, kill).took_s
        same[name] = results(out / "more") == wanted
    return took, same, frames


def share(name: str, took: dict[str, float]) -> str:
    """The speed in per cent of the program's, with as many of it at a time."""
    if name.startswith("`") or "killed" in name:
        return ""
    count = "two" if name == "two workers" else "one"
    value = took[f"`plumb report`, {count} at a time"] / took[name]
    return f"{100 * value:.0f} %" + ("" if value >= AIM else ", missed")


def peak_mb(logs: pathlib.Path, out: pathlib.Path, workers: int = 1) -> tuple[float, float]:
    """Greatest resident memory of `python -m plumb.fleet`, MB, and its seconds.

    With several workers it is the sum of the peaks of all processes, Dask's among them.
    """
    words = [sys.executable, "-c", PEAK, str(logs), str(fresh(out)), "--workers", str(workers)]
    began_s = time.monotonic()
    peaks: dict[int, int] = {}
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as done:
        with concurrent.futures.ThreadPoolExecutor(1) as beside:
            said = beside.submit(done.communicate)
            while not said.done():
                peaks |= {pid: peak_kb(pid) or peaks.get(pid, 0) for pid in below(done.pid)}
                time.sleep(LOOK_S)
        text, _ = said.result()
    assert done.returncode == 0, words
    # A process may have grown since the last look; the first one states its own peak at the end.
    [own_kb] = re.findall(r"VmHWM:\s+(\d+) kB", text)
    return (int(own_kb) + sum(peaks.values())) / 1024, time.monotonic() - began_s


def peak_kb(pid: int) -> int:
    """Greatest resident memory of a process so far, kB; 0 where it has ended."""
    try:
        status = pathlib.Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return 0
    found = re.search(r"VmHWM:\s+(\d+) kB", status)
    return int(found[1]) if found else 0


def below(pid: int) -> Iterator[int]:
    """The processes that a process has started, and those that they have."""
    for task in pathlib.Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            children = task.read_text().split()
        except OSError:
            continue
        for child in map(int, children):
            yield child
            yield from below(child)


def memory(work: pathlib.Path, parts: list[bytes], largest_gb: float, most: int) -> list[str]:
    """Peak memory over the size of a log, and over the number of logs."""
    lines = ["| what | peak memory | time |", "|---|---:|---:|"]
    peaks = []
    for size_gb in (largest_gb / 100, largest_gb / 10, largest_gb):
        root = work / "one log"
        shutil.rmtree(root, ignore_errors=True)
        date = DAY0.date().isoformat()
        size = round(size_gb * 1e9)
        make(root / "m" / f"{date}.log", parts, int(DAY0.timestamp()) + 3600, size)
        peak, took_s = peak_mb(root, work / "peak")
        peaks.append(peak)
        lines.append(f"| one log of {size_gb:g} GB | {peak:.0f} MB | {took_s:.0f} s |")
        shutil.rmtree(root)
    grown = peaks[-1] - peaks[0]
    many = []
    for count in (most // 100, most // 10, most):
        root = work / f"many {count}"
        make_many(root, parts, count, 30_000, 30)
        for workers, how in ((1, ""), (2, ", two workers, all processes")):
            peak, took_s = peak_mb(root, work / "peak", workers)
            many.append(peak)
            title = f"{count} logs of 30 kB{how}"
            lines.append(f"| {title} | {peak:.0f} MB | {took_s:.0f} s |")
        shutil.rmtree(root)
    text = f"From the smallest log to the largest the peak grows by {grown:.0f} MB. "
    text += f"From {most // 10} logs to {most} it grows by "
    text += f"{each(many[4] - many[2], most)} in one process, and with two workers by "
    text += f"{each(many[5] - many[3], most)} in all processes together. The aim is "
    text += f"{AIM_KB} kB for each log."
    return [*lines, "", text, ""]


def each(grown_mb: float, most: int) -> str:
    """How much memory has grown with the number of logs, in all and for each."""
    kb = 1000 * grown_mb / (most - most // 10)
    return f"{grown_mb:.1f} MB ({kb:.2f} kB for each log)" + ("" if kb <= AIM_KB else ", missed")


def finding(work: pathlib.Path, machines: int, days: int) -> list[str]:
    """Precision and recall of the visits of a synthetic fleet, and the time of the questions."""
    root = work / f"synthetic {machines} x {days}"
    took_s = 0.0
    if not (root / "truth.parquet").exists():
        began_s = time.monotonic()
        synthetic.fleet(root, machines, days, seed=1)
        took_s = time.monotonic() - began_s
    outcome = run(root / "logs", fresh(work / "found"), manifest=root / "manifest.parquet")
    truth = pyarrow.parquet.ParquetFile(root / "truth.parquet").read().to_pylist()
    kinds = {row["machine"]: row["kind"] for row in truth}
    wanted = {row["machine"] for row in truth if row["needs_visit"]}
    found = {visit.machine: visit for visit in visits(work / "found")}
    right = wanted & set(found)
    lines = [
        f"A synthetic fleet of {machines} machines and {days} days, seed 1 ({outcome.logs} logs, "
        f"10 s of bus time each"
        + (f", made in {took_s:.0f} s" if took_s else "")
        + f"): {len(wanted)} machines need a visit, {len(found)} are listed, {len(right)} of them "
        f"rightly. Precision {100 * len(right) / max(len(found), 1):.0f} %, recall "
        f"{100 * len(right) / len(wanted):.0f} %.",
        "",
        "| kind | machines | listed |",
        "|---|---:|---:|",
    ]
    for kind in synthetic.KINDS:
        own = [name for name, one in kinds.items() if one == kind]
        need = ", needs a visit" if kind in synthetic.LOUD else ""
        lines.append(f"| {kind}{need} | {len(own)} | {sum(name in found for name in own)} |")
    wrong = [
        f"{name} ({kinds[name]}): {found[name].reasons[0].text}"
        for name in sorted(set(found) - wanted)
    ]
    wrong += [f"{name} ({kinds[name]}) is not listed" for name in sorted(wanted - set(found))]
    lines += ["", "Wrong: " + ("; ".join(wrong) or "none") + ".", ""]
    times = []
    for question in QUESTIONS:
        began_s = time.monotonic()
        query(work / "found", question)
        times.append(f"{question} {time.monotonic() - began_s:.2f} s")
    return [*lines, f"The questions, the folder opened for each: {', '.join(times)}.", ""]


def section(work: pathlib.Path, given: argparse.Namespace) -> str:
    """The last section of the document."""
    parts = seconds_of_a_bus()
    make_many(work / "small", parts, given.small, 900_000, 10)
    make_many(work / "large", parts, given.large, 60_000_000, 4)
    lines = [
        HEADING,
        "`cargo xtask fleet` prints this section. It was run on "
        f"{os.cpu_count()} processors with Python {sys.version.split()[0]}, program and package of "
        "the same build. A run is timed from the first log to the last, without the start of the "
        f"workers (`plumb report` with its own). Groups have {schedulers.GROUP} logs or "
        f"{schedulers.GROUP_BYTES >> 20} MB at most. The aim is {100 * AIM:.0f} % of the speed of "
        f"as many programs at a time. The fastest of {ROUNDS} rounds counts; before the first the "
        f"load of the machine by others was {os.getloadavg()[0]:.1f}.",
        "",
    ]
    for name, title in [("small", "Logs of 0.9 MB, a minute of a bus"), ("large", "Logs of 60 MB")]:
        lines += speed(work / name, work / "out", title)
    lines += memory(work, parts, given.largest_gb, given.most)
    lines += finding(work, given.machines, given.days)
    return "\n".join(lines).rstrip() + "\n"


def main() -> None:
    """The command line."""
    words = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    words.add_argument("work", type=pathlib.Path, help="folder for logs and results")
    words.add_argument("--write", type=pathlib.Path, help="the document whose last section it is")
    words.add_argument("--small", type=int, default=400)
    words.add_argument("--large", type=int, default=16)
    words.add_argument("--largest-gb", type=float, default=10.0)
    words.add_argument("--most", type=int, default=10_000)
    words.add_argument("--machines", type=int, default=200)
    words.add_argument("--days", type=int, default=30)
    given = words.parse_args()
    text = section(given.work, given)
    print(text)
    if given.write is not None:
        document = given.write.read_text()
        before = re.split(f"^{re.escape(HEADING)}", document, flags=re.MULTILINE)[0]
        given.write.write_text(before + text)


if __name__ == "__main__":
    main()
