"""What the tests share: the program `plumb`, and a log that it has recorded of the twin."""

from __future__ import annotations

import contextlib
import os
import pathlib
import signal
import subprocess
import time
from collections.abc import Iterator

import pytest

import plumb

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
PLUMB = os.environ.get("PLUMB", str(ROOT / "target" / "debug" / "plumb"))

START_ALL = (0x000, b"\x01\x00")


def candump(frames: list[plumb.Frame], start_s: float = 1_790_000_000.0) -> str:
    """Frames as lines of `candump -L`."""
    lines = (
        f"({start_s + frame.time_s:.6f}) can0 {frame.id:03X}#{frame.data.hex().upper()}\n"
        for frame in frames
        if not frame.remote
    )
    return "".join(lines)


def shift(seed: int, seconds: float, words: str = "") -> list[plumb.Frame]:
    """What a machine's bus carries: SYNCs every 20 ms, a turn, and a fault if there is one."""
    twin = plumb.Twin(seed=seed, calibrated=False)
    everything = twin.join(own=True)
    twin.run(1.0)
    twin.send(*START_ALL)
    twin.say("pitch 20")
    if words:
        twin.say(words)
    while twin.now_s < 1.0 + seconds:
        twin.send(0x080)
        twin.run(0.02)
    return list(everything.waiting)


@pytest.fixture(scope="session")
def program() -> pathlib.Path:
    return pathlib.Path(PLUMB)


@pytest.fixture(scope="session")
def log(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """Eight seconds of a machine whose channel B breaks after three, with a damaged line."""
    path = tmp_path_factory.mktemp("logs") / "machine.log"
    text = candump(shift(3, 8.0, "+3 s fault b stuck"))
    lines = text.splitlines(keepends=True)
    lines.insert(len(lines) // 2, "this is no frame\n")
    path.write_text("".join(lines))
    return path


def run(program: pathlib.Path, *words: object) -> subprocess.CompletedProcess[str]:
    """The program with these words."""
    command = [str(program), *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def sentence(program: pathlib.Path, *words: object) -> str:
    """The sentence that the program ends with."""
    done = run(program, *words)
    assert done.returncode == 2, done
    return done.stderr.strip().splitlines()[-1].removeprefix("plumb: ")


class Interrupted(Exception):
    """As KeyboardInterrupt, which would end the tests where it comes too late."""


@contextlib.contextmanager
def interrupted(after_s: float) -> Iterator[None]:
    """A signal after so much time, which ends what is in the block long before its own end.

    It looks for signals ten times a second, and a busy machine may not run it for seconds: so the
    time that it computes counts, which is two seconds or more where it looks for none. What waits
    for a pipe does not compute, and would wait for ever.
    """

    def interrupt(*_: object) -> None:
        raise Interrupted

    before = signal.signal(signal.SIGALRM, interrupt)
    begin, computed = time.monotonic(), time.process_time()
    signal.setitimer(signal.ITIMER_REAL, after_s)
    try:
        with pytest.raises(Interrupted):
            yield
        took, computed = time.monotonic() - begin, time.process_time() - computed
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert computed < after_s + 0.5, computed
    assert took < after_s + 20.0, took
