"""The virtual instrument as a bus of python-can, in virtual time.

Virtual time goes on while somebody waits for a frame: `recv(0.5)` lets half a second of it pass at
most, in microseconds of the machine's. A Notifier waits all the time, so beside one virtual time
goes on by itself, as fast as the machine can.
"""

from __future__ import annotations

from typing import Any

import can

from .twin import NS, Frame, Twin

SILENCE_S = 3600.0
"""A wait without an end is given up after this much virtual time."""

STEP_NS = 1_000_000
"""Virtual time between two looks for a frame."""


class TwinBus(can.BusABC):
    """A client of a `Twin`: `TwinBus(twin)`, or `can.Bus(interface="plumb", seed=7)`.

    Further words are those of `Twin`, where none is given. `receive_own_messages` as in python-can.
    """

    def __init__(
        self,
        channel: Any = None,
        can_filters: can.typechecking.CanFilters | None = None,
        twin: Twin | None = None,
        receive_own_messages: bool = False,
        **words: Any,
    ) -> None:
        if isinstance(channel, Twin):
            channel, twin = None, channel
        self.twin = Twin(**words) if twin is None else twin
        self.channel_info = "virtual instrument of Plumb"
        self._client = self.twin.join(own=receive_own_messages)
        super().__init__(channel="plumb" if channel is None else channel, can_filters=can_filters)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next message that passes the filters, or None after `timeout` of virtual time.

        The method of the base class would take the timeout from the machine's clock.
        """
        world = self.twin._world
        until_ns = world.now_ns + round((SILENCE_S if timeout is None else timeout) * NS)
        while (frame := self._next(until_ns)) is not None:
            message = self._message(frame)
            if self._matches_filters(message):
                return message
        if timeout is None:
            raise can.CanOperationError("no message for an hour of virtual time")
        return None

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return self.recv(timeout), True

    def _next(self, until_ns: int) -> Frame | None:
        """The next frame, for which time goes on to `until_ns` at most."""
        world, waiting = self.twin._world, self._client.waiting
        while not waiting and (now_ns := world.now_ns) < until_ns:
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
        if msg.is_fd or msg.is_error_frame:
            raise can.CanOperationError("the virtual bus has classical frames only")
        self._client.send(
            msg.arbitration_id,
            bytes(msg.data),
            extended=msg.is_extended_id,
            remote=msg.is_remote_frame,
            length=msg.dlc,
        )

    def shutdown(self) -> None:
        """Leaves the bus; the instrument stays."""
        self._client.close()
        super().shutdown()
