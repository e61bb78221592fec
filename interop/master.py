"""A CANopen master for the tests: python-canopen on a bus of `plumb serve`, with all frames kept.

`Plumb` runs the program; `Master` is a client of its bus. A master keeps every frame that it has
received, so a test first does something and then asks what came of it.
"""

from __future__ import annotations

import logging
import os
import pathlib
import queue
import re
import subprocess
import threading
import time
from typing import Any, Callable, Iterable, Iterator

import can
import canopen
import pytest

ROOT = pathlib.Path(__file__).resolve().parent.parent
PLUMB = os.environ.get("PLUMB", str(ROOT / "target" / "debug" / "plumb"))

# The program that runs the exact image on emulated boards.
EMULATED = pathlib.Path(PLUMB).stem == "emulate"

# The instrument that `plumb serve` builds where a test sets none: the product, or the paper's.
MODE = os.environ.get("PLUMB_MODE", "product")

# The data sheets of what is served: the virtual instrument has the objects of both.
SHEETS = "plumb-paper" if EMULATED and MODE == "paper" else "plumb"

# The instrument's own data sheets: a master of the product's uses that with a gyroscope unchanged.
OWN_SHEETS = "plumb-dynamic" if MODE == "dynamic" else SHEETS

# It warns whenever a piece of TCP ends within a frame, which is no fault.
logging.getLogger("can.interfaces.socketcand").setLevel(logging.ERROR)

# Limits of waits are what a machine without other work needs by far; one that is busy, or does not
# run a process for seconds, gets so many times as long. What is waited for ends the wait, and how
# long something takes is judged by the time stamps of the bus.
PATIENCE = 10

# A frame of the tests' own, above every COB-ID in use but those of LSS: nothing answers it.
PROBE = 0x7DF

START, STOP, PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 0x01, 0x02, 0x80, 0x81, 0x82
INVALID16, INVALID32 = -0x8000, -0x80000000


class Plumb:
    """A running `plumb serve` on a port of its own. Use as a context manager."""

    def __init__(self, *arguments: str) -> None:
        command = [PLUMB, "serve", "--listen", "127.0.0.1:0", *arguments]
        self.speed = dict(zip(arguments, arguments[1:])).get("--speed", "1")
        if MODE != "product" and "--mode" not in arguments:
            command += ["--mode", MODE]
        if EMULATED and "PLUMB_IMAGES" in os.environ:
            command += ["--images", os.environ["PLUMB_IMAGES"]]
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            bufsize=1,
        )
        self.lines: queue.Queue[str | None] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()
        self.ready = self.printed("serving ", 60)
        self.port = int(re.search(r"socketcand [\d.]+:(\d+)", self.ready)[1])
        if EMULATED:
            # Until its bootloader and its start are through, a real image's boot-up message is
            # still to come, and would pass for that of a reset.
            self.rest(0.5)

    def _read(self) -> None:
        for line in self.process.stdout:
            self.lines.put(line.rstrip())
        self.lines.put(None)

    def printed(self, what: str, timeout: float = 10) -> str:
        """The next printed line with `what` in it."""
        end = time.monotonic() + PATIENCE * timeout
        while True:
            try:
                line = self.lines.get(timeout=max(end - time.monotonic(), 0.001))
            except queue.Empty:
                raise AssertionError(f"plumb never printed {what!r}") from None
            if line is None:
                self.lines.put(None)
                raise AssertionError(f"plumb ended before it printed {what!r}")
            if what in line:
                return line

    def type(self, *words: str) -> None:
        """Types lines into the running program. They may overtake a frame that was sent before:
        where the order counts, the master settles first."""
        for word in words:
            self.process.stdin.write(word + "\n")
        self.process.stdin.flush()

    def truth(self) -> tuple[float, float]:
        """Where the housing really is: slope X (roll) and slope Y (pitch), degrees."""
        self.type("status")
        found = re.search(r"pitch (-?[\d.]+) deg, roll (-?[\d.]+) deg", self.printed("bus load"))
        return float(found[2]), float(found[1])

    def rest(self, seconds: float) -> None:
        """Lets pass what is so much time on a machine that keeps up with the bus, however slow this
        one is; what was typed before has been done by then."""
        self.type(f"+{seconds * float(self.speed):.6f} status")
        self.printed("bus load", seconds + 6)

    def turn(self, pitch: float, roll: float = 0.0, rate: float = 90.0) -> None:
        """Turns the housing and returns once it stands there."""
        # Level first: the two slopes together can't be those of the old pose and the new one.
        self.type(f"rate {rate}", "level", f"pitch {pitch}", f"roll {roll}")
        until(lambda: self.truth() == (roll, pitch), f"{pitch} deg", 400 / rate + 3)
        self.rest(0.2)

    def stop(self) -> None:
        """Ends the program."""
        self.process.kill()
        self.process.wait()

    def __enter__(self) -> Plumb:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def opened(address: dict) -> can.BusABC:
    """A connection to the bus. python-can reads the answer to its command at once and gives up when
    frames have come with it, as they may on a loaded machine."""
    for _ in range(4):
        try:
            return can.Bus(**address)
        except can.CanError:
            pass
    return can.Bus(**address)


class Master(can.Listener):
    """A client of the bus with an SDO client for each node; keeps what it receives."""

    def __init__(
        self, plumb: Plumb, nodes: Iterable[int] = (1, 2), sheets: str = SHEETS
    ) -> None:
        self.plumb = plumb
        self.frames: list[can.Message] = []
        self.network = canopen.Network()
        self.network.listeners.append(self)
        self.address = dict(
            interface="socketcand", host="127.0.0.1", port=plumb.port, channel="plumb"
        )
        self.network.connect(**self.address)
        paths = [ROOT / "eds" / f"{sheets}-{channel}.eds" for channel in "ba"]
        self.nodes = {id: self.network.add_node(id, str(paths[id % 2])) for id in nodes}
        for node in self.nodes.values():
            node.sdo.RESPONSE_TIMEOUT = 30.0

    def on_message_received(self, message: can.Message) -> None:
        """python-can calls this from its thread with every frame."""
        self.frames.append(message)

    def send(self, identifier: int, data: bytes = b"") -> None:
        """Sends a frame."""
        self.network.send_message(identifier, data)

    def nmt(self, command: int, node: int = 0) -> None:
        """Sends an NMT command to a node, or to all of them."""
        self.send(0, bytes([command, node]))

    def sync(self, counter: int | None = None) -> None:
        """Sends SYNC, with a counter if there is one."""
        self.send(0x80, b"" if counter is None else bytes([counter]))

    def settle(self) -> None:
        """Returns when the frames of this master have been on the bus, and when it has received all
        that was there. A loaded machine may take its time for either: what another program was
        answered would pass for an answer to this master, and an old state for the one commanded."""
        other = opened(self.address)
        try:
            self.send(PROBE, b"\x01")
            end = time.monotonic() + 6 * PATIENCE
            while (frame := other.recv(1)) is None or frame.arbitration_id != PROBE:
                assert time.monotonic() < end, "what was sent never came to the bus"
            mark = self.mark()
            other.send(can.Message(arbitration_id=PROBE, data=b"\x02", is_extended_id=False))
            self.next(PROBE, mark)
        finally:
            other.shutdown()

    def rest(self, seconds: float) -> None:
        """As that of `plumb`, behind what this master has sent; it has received all of it then."""
        self.settle()
        self.plumb.rest(seconds)
        self.settle()

    def mark(self) -> int:
        """Frames kept from here on are the newer ones."""
        return len(self.frames)

    def since(self, mark: int, identifier: int) -> list[can.Message]:
        """The frames with this identifier since the mark."""
        return [f for f in self.frames[mark:] if f.arbitration_id == identifier]

    def next(
        self,
        identifier: int,
        mark: int,
        timeout: float = 6.0,
        data: Callable[[bytes], bool] = lambda _: True,
    ) -> can.Message:
        """The first frame with this identifier, and data that fit, since the mark."""
        found: list[can.Message] = []

        def look() -> bool:
            found[:] = [f for f in self.since(mark, identifier) if data(bytes(f.data))]
            return bool(found)

        def came() -> str:
            seen = [bytes(f.data).hex() for f in self.since(mark, identifier)]
            times = [f.timestamp for f in self.frames[mark:]]
            passed_s = times[-1] - times[0] if times else 0.0
            return f"; in {passed_s:.1f} s of the bus there came {seen[-8:]}"

        until(look, f"frame {identifier:03X}h", timeout, came)
        return found[0]

    def read(self, node: int, index: int, sub: int = 0) -> int:
        """SDO upload of a number, with its type in the data sheet."""
        return self._variable(node, index, sub).raw

    def write(self, node: int, index: int, sub: int, value: Any) -> None:
        """SDO download of a number, with its type in the data sheet."""
        self._variable(node, index, sub).raw = value

    def _variable(self, node: int, index: int, sub: int) -> Any:
        entry = self.nodes[node].sdo[index]
        return entry if isinstance(entry, canopen.sdo.SdoVariable) else entry[sub]

    def refusal(self, node: int, index: int, sub: int, data: bytes) -> int:
        """The abort code with which a download of these bytes is refused; 0 if it is taken."""
        try:
            self.nodes[node].sdo.download(index, sub, data)
        except canopen.SdoAbortedError as abort:
            return abort.code
        return 0

    def reboot(self, node: int = 0, command: int = RESET_NODE) -> None:
        """Resets one node or all, and waits for their boot-up; their angles come later."""
        mark = self.mark()
        self.nmt(command, node)
        for id in self.nodes if node == 0 else [node]:
            self.next(0x700 + id, mark, data=lambda d: d == b"\0")

    def reset(self, node: int = 0, command: int = RESET_NODE) -> None:
        """Resets one node or all, and waits until they are there with valid angles."""
        self.reboot(node, command)
        for id in self.nodes if node == 0 else [node]:
            until(lambda: self.read(id, 0x2020) & 0x03, f"angles of node {id}", 10)

    def compare(self) -> None:
        """Sends SYNC until all nodes agree: before that no slope counts in OPERATIONAL."""

        def agreed() -> bool:
            self.sync()
            time.sleep(0.02)
            return all(self.read(node, 0x2021) == 1 for node in self.nodes)

        until(agreed, "agreement", 10)

    def close(self) -> None:
        """Leaves the bus."""
        self.network.disconnect()

    def __enter__(self) -> Master:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@pytest.fixture(scope="module")
def joined(plumb: Plumb) -> Iterator[Master]:
    """A master on the bus of the module's `plumb`."""
    with Master(plumb) as master:
        yield master


@pytest.fixture
def master(plumb: Plumb, joined: Master) -> Master:
    """The same with both nodes fresh from a reset, and no SYNC but the master's."""
    # A test that fails leaves its fault behind, and the next ones would fail of it.
    plumb.type("heal all")
    # What was typed has been done when this is answered; a frame may overtake it.
    plumb.truth()
    joined.reset()
    for node in joined.nodes:
        joined.write(node, 0x2050, 1, 0)
    return joined


PROOF_S = 0.7
"""A channel goes on alone when it has agreed with the other one for half a second."""


def unseen(plumb: Plumb, master: Master, line: str) -> None:
    """What is typed happens while both are in PRE-OPERATIONAL: nobody sees a channel move."""
    master.nmt(PRE_OPERATIONAL)
    master.settle()
    plumb.type(line)
    plumb.rest(0.5)
    master.nmt(START)


def loosen(plumb: Plumb, master: Master) -> None:
    """B's board comes loose, and nobody sees which one moves."""
    unseen(plumb, master, "fault b offset 20")


def until(
    condition: Callable[[], Any],
    what: str,
    timeout: float = 6.0,
    instead: Callable[[], str] = str,
) -> Any:
    """Waits for a condition; what it was waiting for, and what came instead, is told when it never
    comes."""
    end = time.monotonic() + PATIENCE * timeout
    while True:
        if found := condition():
            return found
        assert time.monotonic() < end, f"never came: {what}{instead()}"
        time.sleep(0.002)


def gaps(frames: list[can.Message]) -> list[float]:
    """Times between frames, seconds of the virtual bus."""
    return [b.timestamp - a.timestamp for a, b in zip(frames, frames[1:])]


def signed(data: bytes) -> list[int]:
    """Little-endian signed 16-bit numbers."""
    return [int.from_bytes(data[i : i + 2], "little", signed=True) for i in range(0, len(data), 2)]


def slopes(data: bytes) -> list[int]:
    """Slope X and Y of TPDO 1 as delivered; validity and state are in the two bytes behind them."""
    assert len(data) == 6
    return signed(data[:4])
