"""How fast logs are decoded: `plumb replay` beside python-can with canopen, on the same log.

    python interop/bench_decoding.py [LOG]

prints frames per second of processor time of both and their ratio; each uses one core. Both read
the text, decode every PDO of both nodes by its mapping, follow heartbeats and EMCY; `plumb` also
validates each value and compares the two channels. Without a LOG one is made: two nodes at 100 SYNC/s. `PLUMB` names the program.
Where valgrind is installed, its count of instructions per frame follows, in which there is no
noise.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import pathlib
import re
import resource
import shutil
import struct
import subprocess
import sys
import tempfile
import time
from typing import Iterator

import can
import canopen

ROOT = pathlib.Path(__file__).resolve().parent.parent
PLUMB = os.environ.get("PLUMB", str(ROOT / "target" / "debug" / "plumb"))
NODES = (1, 2)
START_S = 1_700_000_000
CIRCLE = 1 << 24


def lines() -> Iterator[str]:
    """A healthy pair that moves, for ever; what 2024h holds fits the angles."""
    differences = [0, 0]
    for number in itertools.count():
        us = number * 10_000
        base = 30 * math.sin(number / 150)
        angles = [base + 0.010 * math.sin(number / 7), base - 0.012]
        yield line(us, 0x080, b"")
        for node, angle in zip(NODES, angles):
            slope = round(angle * 100)
            yield line(us + 400 * node, 0x180 + node, struct.pack("<hhBB", slope, 5, 0x3F, 1))
        if number % 10 == 9:
            for node, difference in zip(NODES, differences):
                data = struct.pack("<BBHBhb", 0x3F, 1, 24, 30, difference, 25)
                yield line(us + 1000 + 400 * node, 0x280 + node, data)
        steps = [round(angle / 360 * CIRCLE) for angle in angles]
        for node, step in zip(NODES, steps):
            data = step.to_bytes(3, "little", signed=True) + bytes([0, 0, 0, 0x68, 0x68])
            yield line(us + 2000 + 400 * node, 0x380 + node, data)
        for node in NODES:
            data = struct.pack("<hhhBB", 10, -20, 8100, number % 250, 3)
            yield line(us + 3000 + 400 * node, 0x480 + node, data)
        apart = round((steps[0] - steps[1]) * 360_000 / CIRCLE)
        differences = [apart, -apart]
        if number % 20 == 0:
            for node in NODES:
                yield line(us + 5000 + 400 * node, 0x700 + node, b"\x05")


def line(us: int, cob_id: int, data: bytes) -> str:
    seconds, us = divmod(us, 1_000_000)
    return f"({START_S + seconds}.{us:06d}) can0 {cob_id:03X}#{data.hex().upper()}\n"


def write_log(path: pathlib.Path, frames: int) -> None:
    """A log of so many frames."""
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.writelines(itertools.islice(lines(), frames))


def by_plumb(path: pathlib.Path) -> tuple[float, dict]:
    """Frames per second of processor time, of a whole run, and what it has found."""
    before = processor_s()
    done = subprocess.run([PLUMB, "replay", str(path), "--json"], check=True, stdout=subprocess.PIPE)
    spent = processor_s() - before
    report = json.loads(done.stdout)
    return report["frames"] / spent, report


def processor_s() -> float:
    """Processor time of the programs that have ended; `os.times` has steps of 10 ms, this has not."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def by_python(path: pathlib.Path, most: int) -> float:
    """Frames per second of processor time, of python-can's reader and python-canopen's decoding, of
    at most so many frames; the time to read the data sheets is left out."""
    network = canopen.Network()
    decoded = 0

    def take(pdo: canopen.pdo.base.PdoMap) -> None:
        nonlocal decoded
        for variable in pdo:
            variable.raw
        decoded += 1

    for node_id, channel in zip(NODES, "ab"):
        node = canopen.RemoteNode(node_id, str(ROOT / "eds" / f"plumb-{channel}.eds"))
        network.add_node(node)
        node.tpdo.read(from_od=True)
        for number in range(1, 5):
            node.tpdo[number].add_callback(take)
            node.tpdo[number].subscribe()
    frames = 0
    started = time.process_time()
    for message in itertools.islice(can.LogReader(path), most):
        network.notify(message.arbitration_id, bytearray(message.data), message.timestamp)
        frames += 1
    elapsed = time.process_time() - started
    assert decoded > frames / 2, "the PDOs were not decoded"
    return frames / elapsed


def instructions(path: pathlib.Path) -> float:
    """Instructions of the program per frame: those of a longer log less those of a shorter one."""

    def count(frames: int) -> int:
        part = path.with_name(f"part-{frames}.log")
        with path.open(encoding="ascii") as whole, part.open("w", encoding="ascii") as file:
            file.writelines(itertools.islice(whole, frames))
        out = path.with_name("callgrind.out")
        command = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", PLUMB]
        command += ["replay", str(part), "--json"]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        return int(re.search(r"I\s+refs:\s+([\d,]+)", done.stderr)[1].replace(",", ""))

    few, many = 1000, 101_000
    return (count(many) - count(few)) / (many - few)


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "bench.log"
        if len(sys.argv) > 1:
            shutil.copyfile(sys.argv[1], path)
        else:
            write_log(path, 1_000_000)
        by_plumb(path)  # into the page cache
        ours = max(by_plumb(path)[0] for _ in range(5))
        theirs = max(by_python(path, 200_000) for _ in range(3))
        counted = instructions(path) if shutil.which("valgrind") else None
    print(f"plumb replay          {ours:12,.0f} frames/s")
    print(f"python-can + canopen  {theirs:12,.0f} frames/s")
    print(f"ratio                 {ours / theirs:12,.0f}")
    if counted is not None:
        print(f"instructions          {counted:12,.0f} per frame of plumb replay")


if __name__ == "__main__":
    main()
