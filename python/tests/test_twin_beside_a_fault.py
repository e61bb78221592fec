"""The channel beside a faulty one, while that one begins anew and when its fault has ended."""

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
    "fault", ["bias y 50 mg", "bias x 10 mg", "noise 10", "rate-bias y 2 deg/s", "swapped"]
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
    assert exchanges(twin, 45.0) == {A: (0, 7), B: (3, 8)}
    twin.say("heal a")
    assert exchanges(twin, 8.0) == {A: (3, 1), B: (3, 1)}


def turning(twin: plumb.Twin, seconds: float) -> list[tuple[int, int]]:
    """The machine pitches to and fro for so long; what B showed at each SYNC."""
    shown = []
    for number in range(round(seconds / 0.02)):
        if number % 60 == 0:
            twin.say(f"pitch {15 if number % 120 else -15}")
        shown.append(exchanges(twin, 0.02)[B])
    return shown


@pytest.mark.parametrize("fault", ["rate-frozen", "frozen y", "sag", "brown-out"])
def test_a_healthy_channel_disagreed_with_a_faulty_one_that_began_anew(fault: str) -> None:
    twin = plumb.Twin(seed=7, mode="dynamic")
    twin.say("rate 25")
    twin.run(1.0)
    twin.send(*START_ALL)
    assert exchanges(twin, 10.0) == {A: (3, 1), B: (3, 1)}
    turning(twin, 4.0)
    twin.say(f"fault a {fault}")
    # Until the fault is found.
    turning(twin, 3.0)
    assert set(turning(twin, 6.0)) == {(3, 8)}
    twin.say("heal a")
    assert set(turning(twin, 6.0)) == {(3, 8)}
    # 2004h is 0: the fault is over with a reset of A.
    twin.send(0x000, bytes([129, A]))
    turning(twin, 1.0)
    twin.send(*START_ALL)
    turning(twin, 8.0)
    assert exchanges(twin, 0.1) == {A: (3, 1), B: (3, 1)}
