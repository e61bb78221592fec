"""The virtual instrument in virtual time, for tests that break it and look at what follows."""

from __future__ import annotations

import math
import operator
import threading
from collections import deque
from typing import Callable, Iterable, NamedTuple

from . import _plumb
from ._plumb import Error
from .logs import node_ids as ids_of
from .single import Single

NS = 1_000_000_000

LONGEST_S = 100 * 365.25 * 86_400
"""The virtual clock counts ns in 64 bits, which are 584 years."""

IDS = 1 << 29
"""Identifiers that there are, with 29 bits."""


def _ns(seconds: float, name: str) -> int:
    """A time in ns.

    Errors: `Error` where it is negative, not finite, or beyond the virtual clock.
    """
    try:
        is_time = math.isfinite(seconds) and seconds >= 0
    except TypeError:
        is_time = False
    except OverflowError:
        raise Error(f"{name} is a time in s, and not a number of hundreds of digits") from None
    if not is_time:
        raise Error(f"{name} is a time from 0 on, and not {seconds!r}")
    if seconds > LONGEST_S:
        raise Error(f"{name} is {seconds} s: give at most {LONGEST_S:.0f} s, 100 years")
    return round(seconds * NS)


def _whole(given: int, name: str) -> int:
    """A whole number; `Error` where it is none."""
    try:
        return operator.index(given)
    except TypeError:
        raise Error(f"{name} is {given!r}: give a whole number") from None


def _bytes(given: bytes | Iterable[int]) -> bytes:
    """The data of a frame; `Error` where they are none."""
    try:
        # Of a number Python makes so many zeros.
        return bytes(given if isinstance(given, (bytes, bytearray)) else memoryview(given))
    except TypeError:
        pass
    try:
        return bytes(list(given))
    except (TypeError, ValueError):
        raise Error(f"data are {given!r}: give bytes, or numbers of 0 to 255") from None


def _node_ids(given: Iterable[int]) -> list[int]:
    """Node-ids; `Error` where one is none."""
    try:
        return ids_of(given)
    except Error as error:
        raise Error(f"node_ids: {error}") from None


def _seed(given: int) -> int:
    """A seed; `Error` where it is none."""
    seed = _whole(given, "seed")
    if not 0 <= seed < 2**64:
        raise Error(f"seed is {seed}: give a whole number from 0 to 2^64 - 1")
    return seed


class Frame(NamedTuple):
    """A frame that was on the bus."""

    time_s: float
    """When it ended, s of virtual time."""
    id: int
    data: bytes
    extended: bool
    """An identifier of 29 bits."""
    remote: bool
    length: int
    """The length code; of a remote frame the length that is asked for."""
    client: int | None
    """The client that sent it; None for a node."""


class Truth(NamedTuple):
    """Where the housing truly stands."""

    slope_x_deg: float
    """Slope X, or the turn of a one-axis instrument."""
    slope_y_deg: float
    air_degc: float
    die_degc: float


class Client:
    """A client of a twin's bus, with the frames that it has not taken yet."""

    def __init__(self, twin: Twin, number: int, own: bool) -> None:
        self._twin = twin
        self.number = number
        self.own = own
        self.waiting: deque[Frame] = deque()

    def send(
        self,
        id: int,
        data: bytes = b"",
        *,
        extended: bool = False,
        remote: bool = False,
        length: int | None = None,
    ) -> None:
        """Puts a frame onto the bus; it goes out while virtual time goes on."""
        id = _whole(id, "id")
        if not 0 <= id < IDS:
            raise Error(f"{id} is no identifier: give 0 to 7FFh, or to 1FFFFFFFh where extended")
        data = _bytes(data)
        size = len(data) if length is None else _whole(length, "length")
        frame = (id, extended, remote, size, data)
        if not self._twin._world.send(self.number, frame):
            raise Error("too many frames of this client wait already: let time go on")

    def close(self) -> None:
        """Takes no more frames."""
        self._twin._clients.discard(self)


class Timer:
    """Something that is done at its virtual time, and may then be due again."""

    due_ns: int

    def expire(self) -> None:
        """Does it; `due_ns` is later then, or the timer has been stopped."""
        raise NotImplementedError


class Twin(Single):
    """The virtual instrument on a bus of its own; its clock goes on only when it is told to.

    The same seed, words, frames and times give the same frames. `mode` is product, dynamic, paper
    or one-axis; `calibrated=False` leaves out the virtual bench, which takes a third of a second.
    `node_ids` are given in the order a, b, a2, b2. `bit_rate` in kbit/s.

    Errors: `Error` where an argument is wrong.
    """

    def __init__(
        self,
        seed: int = 1,
        mode: str = "product",
        *,
        instruments: int = 1,
        node_ids: Iterable[int] | None = None,
        bit_rate: int = 250,
        chamber_speed: float = 1.0,
        calibrated: bool = True,
    ) -> None:
        words = {
            "seed": _seed(seed),
            "mode": mode,
            "instruments": _whole(instruments, "instruments"),
            "bit-rate": _whole(bit_rate, "bit_rate"),
            "chamber-speed": chamber_speed,
        }
        if node_ids is not None:
            words["node-ids"] = ",".join(map(str, _node_ids(node_ids))) or "none"
        line = [f"--{name}={value}" for name, value in words.items()]
        line += [] if calibrated else ["--uncalibrated"]
        self._world = _plumb.World(line)
        self._clients: set[Client] = set()
        self._timers: list[Timer] = []
        # Two threads that let time go on would both find the same timer due.
        self._going = threading.RLock()
        self._numbers = 0
        self._own = self.join()

    @property
    def now_s(self) -> float:
        """Virtual time, s."""
        return self._world.now_ns / NS

    @property
    def truth(self) -> Truth:
        """Where the housing truly stands, and how warm air and die are."""
        (x, y), (air, die) = self._world.truth()
        return Truth(x, y, air, die)

    def say(self, words: str) -> str:
        """Carries out a word of `plumb serve`, such as `pitch 30` or `fault b stuck`, or puts it
        off (`+2 s level`); what it has to tell. `wait 2 s` takes virtual time.

        Errors: `Error` where it can't be carried out, is `quit`, which is for the program, or is
        `wait` while messages are sent periodically, which the word would let pass.
        """
        if not isinstance(words, str) or any("\ud800" <= letter <= "\udfff" for letter in words):
            raise Error(f"{words!r} is no word: give a text such as 'pitch 30'")
        if words.partition("#")[0].split()[-1:] == ["quit"]:
            raise Error("quit ends the program plumb serve: delete the twin instead")
        if self._timers and words.split()[:1] == ["wait"]:
            raise Error("messages are sent periodically: let time go on by run() in place of wait")
        with self._going:
            try:
                return self._world.say(words)
            finally:
                self._deal()

    def send(self, id: int, data: bytes = b"", *, extended: bool = False) -> None:
        """Puts a frame onto the bus."""
        self._own.send(id, data, extended=extended)

    def run(self, seconds: float) -> list[Frame]:
        """Goes on by this much virtual time; the frames since the last call."""
        _ns(seconds, "seconds")
        return self.run_until(self.now_s + seconds)

    def run_until(self, time_s: float) -> list[Frame]:
        """Goes on to this virtual time; the frames since the last call."""
        self._go(_ns(time_s, "time_s"))
        frames = list(self._own.waiting)
        self._own.waiting.clear()
        return frames

    def wait_for(
        self, is_it: Callable[[Frame], bool], timeout_s: float, step_s: float = 0.001
    ) -> Frame | None:
        """Goes on until a frame fulfils `is_it`, for `timeout_s` of virtual time at most.

        The first such frame, also of those that wait already, or None. Frames before it are let go,
        those behind it come next.

        Errors: `Error` where a time is negative or not finite, or the step none.
        """
        if not callable(is_it):
            raise Error(f"is_it is {is_it!r}: give a function that takes a frame")
        end_ns = self._world.now_ns + _ns(timeout_s, "timeout_s")
        step_ns = _ns(step_s, "step_s")
        if step_ns == 0:
            raise Error(f"step_s is a time of 1 ns or more, and not {step_s}")
        while True:
            while self._own.waiting:
                frame = self._own.waiting.popleft()
                if is_it(frame):
                    return frame
            now_ns = self._world.now_ns
            if now_ns >= end_ns:
                return None
            self._go(min(end_ns, now_ns + step_ns))

    def join(self, own: bool = False) -> Client:
        """One more client, which gets every frame from now on; its own too where `own` is true."""
        client = Client(self, self._numbers, own)
        self._numbers += 1
        self._clients.add(client)
        return client

    def _start(self, timer: Timer) -> None:
        self._timers.append(timer)

    def _stop(self, timer: Timer) -> None:
        if timer in self._timers:
            self._timers.remove(timer)

    def _go(self, until_ns: int) -> None:
        """Goes on to `until_ns`, with every timer at its time."""
        with self._going:
            try:
                while (timer := self._due(until_ns)) is not None:
                    self._world.run_until(timer.due_ns)
                    timer.expire()
                self._world.run_until(until_ns)
            finally:
                self._deal()

    def _due(self, until_ns: int) -> Timer | None:
        """The timer that is due first, of several that were started first; None before it."""
        first = min(self._timers, key=lambda timer: timer.due_ns, default=None)
        return None if first is None or first.due_ns > until_ns else first

    def _deal(self) -> None:
        """Gives what was on the bus to the clients."""
        for at_ns, id, extended, remote, length, data, sender in self._world.take_heard():
            frame = Frame(at_ns / NS, id, bytes(data), extended, remote, length, sender)
            # Another thread may join meanwhile.
            for client in list(self._clients):
                if client.own or client.number != sender:
                    client.waiting.append(frame)
