"""A fault that lasts for longer than a channel may look for its vertical, and then ends."""

from __future__ import annotations

import struct

import pytest
from conftest import START_ALL

import plumb

A, B = 1, 2


def exchanges(twin: plumb.Twin, seconds: float) -> dict[int, tuple[int, int]]:
    """SYNCs of so long; validity of the slopes and state of the pair that each node showed last."""
    last: dict[int, tuple[int, int]] = {}
    for _ in range(round(seconds / 0.02)):
        twin.send(0x080)
        for frame in twin.run(0.02):
            if frame.id in (0x180 + A, 0x180 + B):
                last[frame.id - 0x180] = (frame.data[4] & 3, frame.data[5])
    return last


@pytest.mark.parametrize(
    "fault", ["bias y 50 mg", "bias x 10 mg", "noise 10", "rate-bias y 2 deg/s"]
)
def test_a_channel_never_came_back_from_a_fault_of_half_a_minute(fault: str) -> None:
    twin = plumb.Twin(seed=5, mode="dynamic")
    twin.run(1.0)
    for node in (A, B):
        # 2004h: a fault is over when it was not detected for 1 s.
        twin.send(0x600 + node, struct.pack("<BHBI", 0x2B, 0x2004, 0, 1))
        answer = twin.wait_for(lambda frame, node=node: frame.id == 0x580 + node, timeout_s=1.0)
        assert answer is not None and answer.data[0] == 0x60
    twin.send(*START_ALL)
    exchanges(twin, 10.0)
    twin.say(f"fault a {fault}")
    # The angle of the other one may come and go meanwhile (docs/safety.md).
    shown = exchanges(twin, 45.0)
    assert (shown[A], shown[B][1]) == ((0, 7), 8)
    twin.say("heal a")
    assert exchanges(twin, 20.0) == {A: (3, 1), B: (3, 1)}
