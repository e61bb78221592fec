"""What is given by mistake: one sentence, whatever it is."""

from __future__ import annotations

import copy
import pathlib
import pickle
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import plumb
from plumb.bus import TwinBus

TURNED = np.tile(np.array([0, 0, 16384], np.int16), (4, 1))


@pytest.fixture(scope="module")
def twin() -> plumb.Twin:
    return plumb.Twin(calibrated=False)


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
@pytest.mark.parametrize("make", [plumb.Chain, lambda: plumb.Twin(calibrated=False)])
def test_a_copy_of_a_chain_or_twin_was_the_same_one(
    copied: Callable[[Any], Any], make: Callable[[], Any]
) -> None:
    with pytest.raises(plumb.Error, match="can't be copied or pickled: make another "):
        copied(make())


WRONG: list[Callable[[plumb.Twin], Any]] = [
    lambda twin: twin.say(None),
    lambda twin: twin.say(5),
    lambda twin: twin.say(b"x"),
    lambda twin: twin.say("\ud800"),
    lambda twin: twin.send("0x80"),
    lambda twin: twin.send(1.5),
    lambda twin: twin.send(0x80, None),
    lambda twin: twin.send(0x80, 5),
    lambda twin: twin.send(0x80, [300]),
    lambda twin: twin.run("1"),
    lambda twin: twin.run(None),
    lambda twin: twin.run(10**400),
    lambda twin: twin.run(10**5000),
    lambda twin: twin.wait_for(None, 1),
    lambda twin: plumb.merge(None),
    lambda twin: plumb.merge(["x"]),
    lambda twin: plumb.report(None, "r"),
    lambda twin: plumb.report("x", "r"),
    lambda twin: plumb.report(10**13, "r"),
    lambda twin: plumb.report(b"", 5),
    lambda twin: plumb.report(b"", "r", bit_rate="x"),
    lambda twin: plumb.decode("\ud800"),
    lambda twin: plumb.Chain().run([[1, 2, 3]], [2**70]),
    lambda twin: plumb.Chain().run([[2**70, 2, 3]]),
    lambda twin: plumb.Chain().run(accel_g=[[10**400, 0, 0]]),
    lambda twin: plumb.Chain().run(TURNED, temperature_degc=10**400),
    lambda twin: TwinBus(bitrate="250000"),
]


@pytest.mark.parametrize("call", WRONG)
def test_an_argument_of_a_wrong_type_gave_an_error_from_inside(
    call: Callable[[plumb.Twin], Any], twin: plumb.Twin
) -> None:
    with pytest.raises(plumb.Error):
        call(twin)


def test_words_and_time_of_two_threads_upset_each_other(
    twin: plumb.Twin, tmp_path: pathlib.Path
) -> None:
    wrong: list[BaseException] = []

    def often(call: Callable[[], Any]) -> None:
        try:
            for _ in range(100):
                call()
        except BaseException as why:
            wrong.append(why)

    def join() -> None:
        twin.join().close()

    calls = [lambda: twin.say("pitch 10"), lambda: twin.run(0.005), join]
    threads = [threading.Thread(target=often, args=(call,)) for call in calls]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
