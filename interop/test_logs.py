"""Logs of a bus: what others write is read, what is written others read, and how fast."""

from __future__ import annotations

import json
import pathlib
import subprocess
from typing import Iterable

import can
import pytest
from bench_decoding import by_plumb, by_python, write_log
from master import PLUMB

pytestmark = pytest.mark.virtual("no node takes part")

# By measurement it is in the hundreds; a program that is not optimised is slower.
LEAST_RATIO = 20

FRAMES = [
    can.Message(timestamp=1_700_000_000.25, arbitration_id=0x080, is_extended_id=False, data=b""),
    can.Message(
        timestamp=1_700_000_000.250412,
        arbitration_id=0x181,
        is_extended_id=False,
        data=[0xE8, 3, 0, 0, 0x3F, 1],
    ),
    can.Message(timestamp=1_700_000_001.5, arbitration_id=0x18DAF110, data=bytes(range(8))),
    can.Message(
        timestamp=1_700_000_002.75,
        arbitration_id=0x701,
        is_extended_id=False,
        is_remote_frame=True,
        dlc=1,
    ),
]


def replay(*arguments: object) -> dict:
    command = [PLUMB, "replay", "--json", *map(str, arguments)]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)


def same(read: Iterable[can.Message], start: float = 0.0) -> None:
    """The frames, and their times to the microsecond."""
    read = list(read)
    assert len(read) == len(FRAMES)
    for message, frame in zip(read, FRAMES):
        assert message.arbitration_id == frame.arbitration_id
        assert message.is_extended_id == frame.is_extended_id
        assert message.is_remote_frame == frame.is_remote_frame
        assert message.dlc == frame.dlc
        assert frame.is_remote_frame or message.data == frame.data
        assert message.timestamp + start == pytest.approx(frame.timestamp, abs=2e-6)


@pytest.mark.parametrize("ending", ["log", "asc"])
def test_what_python_can_writes_is_read(tmp_path: pathlib.Path, ending: str) -> None:
    path = tmp_path / f"theirs.{ending}"
    with can.Logger(str(path)) as logger:
        for frame in FRAMES:
            logger(frame)
    report = replay(path)
    skipped = {kind["kind"] for kind in report["skipped"]} - {"no_frames"}
    assert (report["frames"], skipped) == (4, set())
    (interface,) = report["interfaces"]
    assert interface["syncs"] == 1
    others = interface["others"]
    assert (others["extended"], others["remote"]) == (1, 1)
    assert interface["last_time_s"] - interface["first_time_s"] == pytest.approx(2.5, abs=1e-5)


@pytest.mark.parametrize("ending", ["log", "asc"])
def test_what_is_written_python_can_reads(tmp_path: pathlib.Path, ending: str) -> None:
    theirs, ours = tmp_path / "theirs.log", tmp_path / f"ours.{ending}"
    with can.Logger(str(theirs)) as logger:
        for frame in FRAMES:
            logger(frame)
    # Its writer leaves away how many bytes a remote frame asks for; its reader reads them.
    theirs.write_text(theirs.read_text().replace("701#R ", "701#R1 "))
    replay(theirs, "--export", ours)
    # An ASC counts from its start, which is the first frame's millisecond.
    start = 1_700_000_000.25 if ending == "asc" else 0.0
    same(can.LogReader(str(ours)), start)


def test_decoding_is_many_times_as_fast_as_in_python(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "bench.log"
    write_log(path, 300_000)
    by_plumb(path)
    ours, report = max((by_plumb(path) for _ in range(3)), key=lambda run: run[0])
    theirs = by_python(path, 30_000)
    print(f"{ours:,.0f} and {theirs:,.0f} frames/s, {ours / theirs:.0f} times")
    assert report["frames"] == 300_000
    for node in report["interfaces"][0]["instruments"][0]["nodes"]:
        assert node["findings"] == [] and node["readings"] > 40_000
    assert ours > LEAST_RATIO * theirs
