"""A synthetic fleet out of the virtual instrument, with drifts and faults that are known.

`python -m plumb.fleet.synthetic OUT --machines 200 --days 30 --seed 1` writes a log for each
machine and day, `manifest.parquet`, and `truth.parquet`: a row for each machine, with what is wrong
with it and whether it needs a visit. A day is a short recording, `--seconds` of bus time (10 by
default) from the power-up in the morning on, at the right date. The same words give the same
bytes.

A machine is one virtual instrument, which is switched off at night. Its controller sends SYNC,
moves, and reads the identity of both nodes. What is wrong is drawn by seed out of `KINDS`.

Left out: wear, weather and work as real machines have them; time between the recordings.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import datetime
import os
import pathlib
import random
import sys
from dataclasses import dataclass, field

import pyarrow

from ..twin import Frame, Twin
from .errors import FleetError
from .progress import Bar
from .store import write, write_table

FIRST_DAY = datetime.date(2026, 9, 1)

MORNING_S = 6 * 3600
"""When a recording begins, s after midnight (UTC)."""

SYNC_S = 0.05
"""Time between two SYNCs."""

MODELS = ("excavator 8 t", "excavator 24 t", "crane 60 t")

QUIET = ("healthy", "transient", "late", "restarted once")
"""Kinds that need no visit: nothing; a fault of one day, long over; a day without data in the middle;
a node that restarted once."""

LOUD = ("drift", "broken", "loose contact", "restarts", "silent", "overdue", "wrong hash")
"""Kinds that need one: A - B drifts out of the band; a sensor that fails for good; a sensor that
fails for a moment, day after day; restarts; no data any more; a calibration that is overdue; one
that is not the certificate's."""

KINDS = (*QUIET, *LOUD)

SHARE_HEALTHY = 0.6
"""Share of machines with nothing wrong."""

TRUTH = pyarrow.schema(
    [
        ("machine", pyarrow.string()),
        ("kind", pyarrow.string()),
        ("needs_visit", pyarrow.bool_()),
        ("since", pyarrow.string()),
        ("drift_deg_per_day", pyarrow.float64()),
    ]
)
"""Columns of truth.parquet."""

MANIFEST = pyarrow.schema(
    [
        (name, pyarrow.string())
        for name in ("path", "machine", "day", "model", "calibration_due", "certificate_crc32")
    ]
)
"""Columns of manifest.parquet."""


@dataclass(frozen=True)
class Machine:
    """A machine, and what is wrong with it."""

    name: str
    seed: int
    kind: str
    since: int
    """Number of the day from which on."""
    drift_mg: float = 0.0
    """Zero-g offset of channel B more every day, mg."""
    model: str = MODELS[0]


@dataclass
class Made:
    """What came of a machine: days with a log, and the check sums of its calibrations."""

    days: list[int] = field(default_factory=list)
    sums: list[str] = field(default_factory=list)


def machines(count: int, days: int, seed: int) -> list[Machine]:
    """The machines of a seed: every kind comes as often as its share, each at its own day."""
    draw = random.Random(seed)
    others = [kind for kind in KINDS if kind != "healthy"]
    drawn = []
    for number in range(count):
        kind = "healthy" if draw.random() < SHARE_HEALTHY else draw.choice(others)
        since = draw.randrange(days // 3, max(days // 3 + 1, 2 * days // 3))
        if kind == "broken":
            since = draw.randrange(days // 2, days)
        drift_mg = draw.choice((-1, 1)) * draw.uniform(1.5, 6) / days if kind == "drift" else 0.0
        name = f"machine {number + 1:03}"
        model = draw.choice(MODELS)
        drawn.append(Machine(name, draw.randrange(2**31), kind, since, drift_mg, model))
    return drawn


def make(machine: Machine, out: pathlib.Path, days: int, seconds: float) -> Made:
    """Writes the logs of a machine."""
    twin = Twin(seed=machine.seed)
    everything = twin.join(own=True)
    made = Made()
    draw = random.Random(machine.seed)
    for number in range(days):
        if _is_silent(machine, number, days):
            continue
        twin.say("power all off")
        twin.run(0.2)
        everything.waiting.clear()
        began_s = twin.now_s
        _break(twin, machine, number, days, draw, seconds)
        sums = _work(twin, seconds, draw)
        made.sums = sums or made.sums
        made.days.append(number)
        day = FIRST_DAY + datetime.timedelta(number)
        morning_s = MORNING_S + datetime.datetime.combine(
            day, datetime.time(), datetime.timezone.utc
        ).timestamp()
        text = _candump(list(everything.waiting), morning_s - began_s)
        write(out / machine.name / f"{day.isoformat()}.log", text.encode())
    return made


def _is_silent(machine: Machine, number: int, days: int) -> bool:
    if machine.kind == "silent":
        return number >= min(machine.since, days - 3)
    return machine.kind == "late" and number == machine.since


def _break(
    twin: Twin, machine: Machine, number: int, days: int, draw: random.Random, seconds: float
) -> None:
    """Heals everything, and breaks what is broken on this day; then the power comes."""
    twin.say("heal all")
    if machine.kind == "drift":
        twin.say(f"fault b bias x {machine.drift_mg * number:.4f}")
    twin.say("power all on")
    middle = 0.5 * seconds
    last = number >= machine.since
    if machine.kind == "broken" and last:
        twin.say(f"+{middle:.2f} s fault b stuck")
    elif machine.kind == "transient" and number == days // 3:
        _for_a_moment(twin, middle)
    elif machine.kind == "loose contact" and last and number % 2 == days % 2:
        _for_a_moment(twin, middle)
    elif machine.kind == "restarts" and last:
        twin.say(f"+{middle:.2f} s reset a")
    elif machine.kind == "restarted once" and number == machine.since:
        twin.say(f"+{middle:.2f} s reset a")


def _for_a_moment(twin: Twin, at_s: float) -> None:
    twin.say(f"+{at_s:.2f} s fault b silent")
    twin.say(f"+{at_s + 1.0:.2f} s heal b")
    twin.say(f"+{at_s + 1.2:.2f} s reset b")


def _work(twin: Twin, seconds: float, draw: random.Random) -> list[str]:
    """A morning: start, identity, motion; the check sums of the calibrations."""
    end_s = twin.now_s + seconds
    twin.run(0.8)
    twin.send(0x000, b"\x01\x00")
    twin.say(f"vibration {draw.uniform(0, 30):.1f}")
    twin.say(f"pitch {draw.uniform(-20, 20):.1f}")
    sums = []
    for node in (1, 2):
        for index, sub in ((0x1018, 1), (0x1018, 2), (0x1018, 3), (0x1018, 4), (0x100A, 0)):
            upload(twin, node, index, sub)
        sums.append(f"{int.from_bytes(upload(twin, node, 0x2062, 1) or b'', 'little'):08X}")
        upload(twin, node, 0x2063, 0)
    while twin.now_s < end_s:
        twin.send(0x080)
        twin.run(SYNC_S)
    return sums


def upload(twin: Twin, node: int, index: int, sub: int) -> bytes | None:
    """Reads an object by SDO (CiA 301, 7.2.4.3); None where the node refuses or does not answer."""
    request = bytes([0x40, index & 0xFF, index >> 8, sub, 0, 0, 0, 0])
    answer = _ask(twin, node, request)
    if answer is None or answer[0] & 0xE0 != 0x40:
        return None
    if answer[0] & 2:
        return answer[4 : 8 - (answer[0] >> 2 & 3)]
    content, toggle = b"", 0
    while (answer := _ask(twin, node, bytes([0x60 | toggle]) + bytes(7))) is not None:
        if answer[0] & 0xE0:
            return None
        content += answer[1 : 8 - (answer[0] >> 1 & 7)]
        if answer[0] & 1:
            return content
        toggle ^= 0x10
    return None


def _ask(twin: Twin, node: int, request: bytes) -> bytes | None:
    twin.send(0x600 + node, request)
    answer = twin.wait_for(lambda frame: frame.id == 0x580 + node, timeout_s=0.5)
    return None if answer is None else answer.data


def _candump(frames: list[Frame], zero_s: float) -> str:
    lines = (
        f"({zero_s + frame.time_s:.6f}) can0 {frame.id:03X}#{frame.data.hex().upper()}\n"
        for frame in frames
        if not frame.remote
    )
    return "".join(lines)


def fleet(
    out: str | os.PathLike[str],
    count: int = 200,
    days: int = 30,
    seed: int = 1,
    *,
    seconds: float = 10.0,
    workers: int | None = None,
    bar: Bar | None = None,
) -> list[Machine]:
    """Writes a fleet into the folder `out`: `logs/`, manifest and truth; its machines.

    Errors: `FleetError` where there are too few days, or it can't be written.
    """
    if days < 3 or count < 1 or seconds < 4.0:
        raise FleetError("a fleet has a machine, three days and 4 s of each day at least")
    folder = pathlib.Path(out)
    all_of_them = machines(count, days, seed)
    made: dict[str, Made] = {}
    with concurrent.futures.ProcessPoolExecutor(workers or os.cpu_count() or 1) as pool:
        started = {
            pool.submit(make, machine, folder / "logs", days, seconds): machine
            for machine in all_of_them
        }
        for done in concurrent.futures.as_completed(started):
            made[started[done].name] = done.result()
            if bar is not None:
                bar("recording", len(made), count, len(made), count)
    _write_tables(folder, all_of_them, made, days)
    return all_of_them


def _write_tables(
    folder: pathlib.Path, all_of_them: list[Machine], made: dict[str, Made], days: int
) -> None:
    listed, truth = [], []
    last = FIRST_DAY + datetime.timedelta(days - 1)
    for machine in all_of_them:
        due = last + datetime.timedelta(-3 if machine.kind == "overdue" else 200)
        sums = made[machine.name].sums
        if machine.kind == "wrong hash":
            sums = [f"{int(one, 16) ^ 1:08X}" for one in sums]
        for number in made[machine.name].days:
            day = (FIRST_DAY + datetime.timedelta(number)).isoformat()
            listed.append(
                {
                    "path": f"{machine.name}/{day}.log",
                    "machine": machine.name,
                    "day": day,
                    "model": machine.model,
                    "calibration_due": due.isoformat(),
                    "certificate_crc32": " ".join(sums),
                }
            )
        truth.append(
            {
                "machine": machine.name,
                "kind": machine.kind,
                "needs_visit": machine.kind in LOUD,
                "since": (FIRST_DAY + datetime.timedelta(machine.since)).isoformat(),
                "drift_deg_per_day": machine.drift_mg * 0.0573,
            }
        )
    write_table(folder / "manifest.parquet", listed, MANIFEST)
    write_table(folder / "truth.parquet", truth, TRUTH)


def main(arguments: list[str] | None = None) -> int:
    """The command line; the exit status."""
    words = argparse.ArgumentParser(
        prog="python -m plumb.fleet.synthetic", description=__doc__.split("\n")[0]
    )
    words.add_argument("out", metavar="OUT", help="folder for logs/, manifest and truth")
    words.add_argument("--machines", type=int, default=200)
    words.add_argument("--days", type=int, default=30)
    words.add_argument("--seed", type=int, default=1)
    words.add_argument("--seconds", type=float, default=10.0, help="bus time of a day")
    words.add_argument("--workers", type=int, help="processes")
    given = words.parse_args(arguments)
    bar = Bar()
    try:
        fleet(
            given.out,
            given.machines,
            given.days,
            given.seed,
            seconds=given.seconds,
            workers=given.workers,
            bar=bar,
        )
    except FleetError as why:
        print(f"plumb.fleet.synthetic: {why}", file=sys.stderr)
        return 2
    finally:
        bar.close()
    print(f"{given.machines} machines of {given.days} days: {given.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
