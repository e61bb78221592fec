"""The virtual instrument as a bus of python-can, in virtual time.

Virtual time goes on while somebody waits for a frame: `recv(0.5)` lets half a second of it pass at
most, in microseconds of the machine's. A Notifier waits all the time, so beside one virtual time
goes on by itself, as fast as the machine can. `send_periodic` goes by virtual time, too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import can

from ._plumb import Error
from .twin import Frame, Timer, Twin, _ns, _whole

SILENCE_S = 3600.0
"""A wait without an end is given up after this much virtual time."""

STEP_NS = 1_000_000
"""Virtual time between two looks for a frame."""


class BusError(can.CanOperationError, Error):
    """What can't be done on the bus: an error of python-can and of this package."""


class PeriodicSend(
    can.broadcastmanager.LimitedDurationCyclicSendTaskABC,
    can.ModifiableCyclicTaskABC,
    can.RestartableCyclicTaskABC,
    Timer,
):
    """Messages that go out one after the other, the first at once, each a period of virtual time
    after the one before it. It stops where one can't be sent, and the call raises that lets time go
    on."""

    def __init__(
        self,
        bus: TwinBus,
        messages: Sequence[can.Message] | can.Message,
        period: float,
        duration: float | None,
        modify: Callable[[can.Message], None] | None,
    ) -> None:
        self._step_ns = _ns(period, "period")
        if self._step_ns == 0:
            raise Error(f"period is a time of 1 ns or more, and not {period}")
        super().__init__(messages, period, duration)
        self._bus = bus
        self._lasts_ns = None if duration is None else _ns(duration, "duration")
        self._end_ns: int | None = None
        self._modify = modify
        self._next = 0

    def start(self) -> None:
        """Begins, or begins again."""
        self.stop()
        self.due_ns = self._bus.twin._world.now_ns
        self._end_ns = None if self._lasts_ns is None else self.due_ns + self._lasts_ns
        self._bus.twin._start(self)
        self.expire()

    def stop(self) -> None:
        """Sends no more."""
        self._bus.twin._stop(self)

    def expire(self) -> None:
        """Sends the next message."""
        if self._end_ns is not None and self.due_ns >= self._end_ns:
            self.stop()
            return
        self.due_ns += self._step_ns
        message = self.messages[self._next]
        self._next = (self._next + 1) % len(self.messages)
        try:
            if self._modify is not None:
                self._modify(message)
            self._bus.send(message)
        except BaseException:
            self.stop()
            raise


def _kbit(bitrate: int, words: dict[str, Any]) -> int:
    """A bit rate of python-can, bit/s, as `Twin` takes it, kbit/s."""
    if "bit_rate" in words:
        raise Error("give either bitrate (bit/s) or bit_rate (kbit/s)")
    kbit, rest = divmod(_whole(bitrate, "bitrate"), 1000)
    if rest:
        raise Error(f"bitrate is {bitrate} bit/s: give a whole number of kbit/s, such as 250000")
    return kbit


class TwinBus(can.BusABC):
    """A client of a `Twin`: `TwinBus(twin)`, or `can.Bus(interface="plumb", seed=7)`.

    Further words are those of `Twin`, where none is given. `bitrate` in bit/s and
    `receive_own_messages` are as in python-can.

    Errors: `Error` where a word is wrong, or beside a `Twin` that is there already; `BusError` of a
    message that can't be sent, and after `shutdown`.
    """

    def __init__(
        self,
        channel: Any = None,
        can_filters: can.typechecking.CanFilters | None = None,
        twin: Twin | None = None,
        receive_own_messages: bool = False,
        bitrate: int | None = None,
        **words: Any,
    ) -> None:
        if isinstance(channel, Twin):
            channel, twin = None, channel
        if bitrate is not None:
            words["bit_rate"] = _kbit(bitrate, words)
        if twin is not None and words:
            raise Error(f"{', '.join(words)} can't be given beside a Twin: give it to Twin(...)")
        self.twin = Twin(**words) if twin is None else twin
        self.channel_info = "virtual instrument of Plumb"
        self._client = self.twin.join(own=receive_own_messages)
        super().__init__(channel="plumb" if channel is None else channel, can_filters=can_filters)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next message that passes the filters, or None after `timeout` of virtual time.

        The method of the base class would take the timeout from the machine's clock.
        """
        self._check_open()
        world = self.twin._world
        wait_s = SILENCE_S if timeout is None else timeout
        # As in python-can a timeout that is over already is none.
        until_ns = world.now_ns + (0 if wait_s < 0 else _ns(wait_s, "timeout"))
        while (frame := self._next(until_ns)) is not None:
            message = self._message(frame)
            if self._matches_filters(message):
                return message
        if timeout is None:
            raise BusError("no message for an hour of virtual time")
        return None

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return self.recv(timeout), True

    def _next(self, until_ns: int) -> Frame | None:
        """The next frame, for which time goes on to `until_ns` at most."""
        world, waiting = self.twin._world, self._client.waiting
        while not waiting and (now_ns := world.now_ns) < until_ns:
            # Another thread may shut the bus down meanwhile.
            self._check_open()
            self.twin._go(min(until_ns, now_ns + STEP_NS))
        return waiting.popleft() if waiting else None

    def _message(self, frame: Frame) -> can.Message:
        return can.Message(
            timestamp=frame.time_s,
            arbitration_id=frame.id,
            is_extended_id=frame.extended,
            is_remote_frame=frame.remote,
            dlc=frame.length,
            data=frame.data,
            is_rx=frame.client != self._client.number,
            channel=self.channel_info,
        )

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Puts a message onto the bus; it goes out while virtual time goes on."""
        self._check_open()
        if msg.is_fd or msg.is_error_frame:
            raise BusError("the virtual bus has classical frames only")
        try:
            self._client.send(
                msg.arbitration_id,
                bytes(msg.data),
                extended=msg.is_extended_id,
                remote=msg.is_remote_frame,
                length=msg.dlc,
            )
        except Error as error:
            raise BusError(str(error)) from None

    def _check_open(self) -> None:
        if self._is_shutdown:
            raise BusError("the bus was shut down: open another one")

    def _send_periodic_internal(
        self,
        msgs: Sequence[can.Message] | can.Message,
        period: float,
        duration: float | None = None,
        autostart: bool = True,
        modifier_callback: Callable[[can.Message], None] | None = None,
    ) -> PeriodicSend:
        task = PeriodicSend(self, msgs, period, duration, modifier_callback)
        if autostart:
            task.start()
        return task

    def shutdown(self) -> None:
        """Leaves the bus; the instrument stays."""
        self._client.close()
        self._client.waiting.clear()
        super().shutdown()
