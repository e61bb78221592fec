"""The virtual instrument in a test: words, frames, python-can, python-canopen."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable

import can
import numpy as np
import pytest
from conftest import START_ALL, interrupted

import plumb
from plumb.bus import TwinBus

A, B = 1, 2


def emergencies(frames: list[plumb.Frame], node: int) -> list[str]:
    """EMCY codes of a node, in their order."""
    own = [frame for frame in frames if frame.id == 0x080 + node and len(frame.data) == 8]
    return [f"{int.from_bytes(frame.data[:2], 'little'):04X}" for frame in own]


def test_the_same_seed_gives_the_same_frames() -> None:
    def frames(seed: int) -> list[plumb.Frame]:
        twin = plumb.Twin(seed=seed, calibrated=False)
        twin.say("+0.5 s roll 5")
        twin.send(*START_ALL)
        return twin.run(2.0)

    assert frames(1) == frames(1) != frames(2)


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="there is no such signal")
@pytest.mark.parametrize("go", [lambda twin: twin.run(1e6), lambda twin: twin.say("wait 1000000 s")])
def test_ctrl_c_waited_for_the_end_of_a_run(go: Callable[[plumb.Twin], object]) -> None:
    twin, whole = (plumb.Twin(seed=1, calibrated=False) for _ in range(2))
    for each in (twin, whole):
        each.send(*START_ALL)
    with interrupted(0.3):
        go(twin)
    # Nothing is lost of what was on the bus until then, and it goes on from there.
    assert 1.0 <= twin.now_s < 1e5
    end_s = twin.now_s + 0.5
    assert twin.run_until(end_s) == whole.run_until(end_s)


def test_a_fault_is_told_and_healed_in_milliseconds() -> None:
    twin = plumb.Twin(calibrated=False)
    twin.run(1.0)
    twin.send(*START_ALL)
    begin = time.monotonic()
    twin.say("fault b stuck")
    frames = twin.run(60.0)
    took = time.monotonic() - begin
    assert "FF01" in emergencies(frames, B), frames
    # A tenth of a second on an idle machine; at the speed of a real instrument a minute.
    assert took < 20.0, took
    assert "FF01" not in emergencies(frames, A)
    twin.say("heal b")
    twin.say("reset b")
    assert any(frame.id == 0x700 + B and frame.data == b"\0" for frame in twin.run(1.0))


def slopes(frames: list[plumb.Frame]) -> list[tuple[int, int]]:
    """Slopes X and Y of TPDO 1 of both nodes; -32768 is 8000h."""
    own = [frame.data for frame in frames if frame.id in (0x180 + A, 0x180 + B)]
    return [tuple(np.frombuffer(data[:4], "<i2").tolist()) for data in own]


@pytest.mark.parametrize("second", ["x 30", "y -30", "z 60"])
@pytest.mark.parametrize("again", [False, True], ids=["standing", "moving"])
def test_a_second_fault_in_a_disagreement_made_the_first_one_valid(second: str, again: bool) -> None:
    twin = plumb.Twin(seed=3)
    twin.send(*START_ALL)
    twin.run(4.0)
    # The first fault begins in a turn and lies across gravity: no channel is named.
    twin.say("rate 20")
    twin.say("roll 40")
    twin.run(0.5)
    twin.say("fault a bias y 50")
    frames = twin.run(62.0)
    assert "FF13" in emergencies(frames, A) and "FF14" not in emergencies(frames, A)
    if again:
        twin.say("roll 20")
        twin.run(0.3)
    twin.say(f"fault b bias {second}")
    frames = twin.run(6.0)
    # The second one is named, and the angle of the first is not valid again.
    assert "FF14" in emergencies(frames, B)
    assert set(slopes(frames)) == {(-0x8000, -0x8000)}


def test_the_truth_is_where_the_words_have_led() -> None:
    twin = plumb.Twin(calibrated=False)
    twin.say("roll 12.5")
    twin.say("temp 40 now")
    twin.say("wait")
    truth = twin.truth
    assert sorted([abs(truth.slope_x_deg), abs(truth.slope_y_deg)]) == pytest.approx([0, 12.5], abs=1e-6)
    assert truth.die_degc == pytest.approx(40.0, abs=0.1)
    assert twin.say("+2 s level") == f"put off to {twin.now_s + 2:.3f} s"
    assert "roll" in twin.say("help")


def test_a_frame_is_waited_for() -> None:
    twin = plumb.Twin(calibrated=False, node_ids=[7, 9])
    boot = twin.wait_for(lambda frame: frame.id == 0x709, timeout_s=1.0)
    assert boot is not None and boot.data == b"\0" and boot.client is None
    assert 0 < boot.time_s <= twin.now_s < 1.0
    assert twin.wait_for(lambda frame: frame.id == 0x123, timeout_s=0.1) is None


@pytest.mark.parametrize("mode", ["product", "paper", "one-axis", "dynamic"])
def test_every_mode_boots(mode: str) -> None:
    twin = plumb.Twin(mode=mode, calibrated=False)
    ids = {frame.id for frame in twin.run(1.0)}
    assert {0x701, 0x702} <= ids, mode


def upload(bus: can.BusABC, node: int, index: int, sub: int = 0) -> int:
    """Reads an object of up to four bytes (CiA 301, 7.2.4.3.6)."""
    ask = bytes([0x40, index & 0xFF, index >> 8, sub]) + bytes(4)
    bus.send(can.Message(arbitration_id=0x600 + node, data=ask, is_extended_id=False))
    while (answer := bus.recv(0.5)) is not None:
        if answer.arbitration_id == 0x580 + node:
            size = 4 - (answer.data[0] >> 2 & 3)
            return int.from_bytes(answer.data[4 : 4 + size], "little", signed=True)
    raise TimeoutError


def test_python_can_reads_the_slope_of_a_calibrated_instrument() -> None:
    with TwinBus(seed=5) as bus:
        bus.twin.say("roll 10")
        bus.twin.say("wait 2 s")
        steps = upload(bus, A, 0x6110), upload(bus, A, 0x6120)
        resolution = upload(bus, A, 0x6000)
    slopes = [step * resolution / 1000 for step in steps]
    truth = bus.twin.truth
    assert slopes == pytest.approx([truth.slope_x_deg, truth.slope_y_deg], abs=0.2)


def test_python_can_finds_the_bus_by_its_name_and_filters() -> None:
    filters = [{"can_id": 0x702, "can_mask": 0x7FF}]
    with can.Bus(interface="plumb", seed=2, calibrated=False, can_filters=filters) as bus:
        boot = bus.recv(1.0)
        assert boot.arbitration_id == 0x702 and bytes(boot.data) == b"\0" and boot.is_rx
        assert boot.timestamp < 1.0
        bus.twin.say("wire b off")
        while bus.recv(0.01) is not None:
            pass
        before_s = bus.twin.now_s
        assert bus.recv(0.25) is None
        assert bus.twin.now_s == pytest.approx(before_s + 0.25)


def test_each_client_hears_the_others_and_itself_if_it_wants() -> None:
    twin = plumb.Twin(calibrated=False)
    with TwinBus(twin) as one, TwinBus(twin, receive_own_messages=True) as two:
        one.send(can.Message(arbitration_id=0x7F1, data=[1, 2], is_extended_id=False))
        two.send(can.Message(arbitration_id=0x1ABCDEF, is_remote_frame=True, dlc=3))
        frames = twin.run(0.05)

        def heard(bus: TwinBus) -> dict[int, can.Message]:
            found = iter(lambda: bus.recv(0), None)
            return {frame.arbitration_id: frame for frame in found}

        by_one, by_two = heard(one), heard(two)
    assert 0x7F1 not in by_one and not by_two[0x1ABCDEF].is_rx
    remote = by_one[0x1ABCDEF]
    assert remote.is_remote_frame and remote.is_extended_id and remote.dlc == 3
    assert bytes(by_two[0x7F1].data) == b"\1\2" and by_two[0x7F1].is_rx
    assert {0x7F1, 0x1ABCDEF} <= {frame.id for frame in frames}


def test_python_canopen_reads_an_object_beside_virtual_time() -> None:
    import canopen

    network = canopen.Network(bus=TwinBus(calibrated=False))
    network.connect()
    try:
        node = network.add_node(A, canopen.ObjectDictionary())
        data = node.sdo.upload(0x1018, 4)
        assert len(data) == 4
    finally:
        network.disconnect()


SYNC = can.Message(arbitration_id=0x080, is_extended_id=False)

START = can.Message(arbitration_id=0x000, data=[1, 0], is_extended_id=False)


def received(bus: TwinBus, id: int, seconds: float) -> list[float]:
    """Times of the messages of this identifier within so much virtual time."""
    end_s = bus.twin.now_s + seconds
    times = []
    while (left_s := end_s - bus.twin.now_s) > 0 and (message := bus.recv(left_s)) is not None:
        if message.arbitration_id == id:
            times.append(message.timestamp)
    return times


def test_a_periodic_sync_went_by_the_clock_of_the_machine() -> None:
    def slopes() -> list[float]:
        with TwinBus(calibrated=False, receive_own_messages=True) as bus:
            bus.send(START)
            bus.recv(1.0)
            task = bus.send_periodic(SYNC, 0.02)
            times = received(bus, 0x181, 3.0)
            task.stop()
            # A node sends the SYNCs itself where nobody else does, each 40 ms.
            assert len(received(bus, 0x080, 1.0)) in (24, 25, 26)
            task.start()
            assert len(received(bus, 0x080, 1.0)) in (49, 50, 51)
        return times

    times = slopes()
    assert len(times) in (149, 150, 151) and times == slopes()
    assert np.diff(times) == pytest.approx(0.02, abs=0.002)


def test_periodic_messages_end_change_and_are_modified() -> None:
    with TwinBus(calibrated=False, receive_own_messages=True) as bus:
        counter = can.Message(arbitration_id=0x7F1, data=[0], is_extended_id=False)

        def count(message: can.Message) -> None:
            message.data[0] += 1

        bus.send_periodic(counter, 0.1, duration=0.35, modifier_callback=count)
        late = bus.send_periodic(
            [can.Message(arbitration_id=0x7F2, data=[n], is_extended_id=False) for n in (5, 6)],
            0.1,
            autostart=False,
        )
        bus.twin.run(1.0)
        found = list(iter(lambda: bus.recv(0), None))
        own = [message.data[0] for message in found if message.arbitration_id == 0x7F1]
        assert own == [1, 2, 3, 4] and 0x7F2 not in {one.arbitration_id for one in found}
        late.start()
        bus.twin.run(0.25)
        late.modify_data(
            [can.Message(arbitration_id=0x7F2, data=[n], is_extended_id=False) for n in (7, 8)]
        )
        bus.twin.run(0.2)
        found = iter(lambda: bus.recv(0), None)
        assert [one.data[0] for one in found if one.arbitration_id == 0x7F2] == [5, 6, 5, 8, 7]
        with pytest.raises(plumb.Error, match="^messages are sent periodically: let time go on by"):
            bus.twin.say("wait 1 s")
        late.stop()
        assert bus.twin.say("wait 1 s") == ""
        for period in (0.0, -1.0, float("nan")):
            with pytest.raises(plumb.Error, match="^period is a time"):
                bus.send_periodic(SYNC, period)
        bus.send_periodic(SYNC, 0.1)
    assert bus.twin._timers == []


def test_periodic_messages_that_the_bus_has_no_room_for_stop_with_an_error() -> None:
    with TwinBus(calibrated=False) as bus:
        bus.send_periodic(SYNC, 1e-6)
        with pytest.raises(plumb.Error, match="too many frames of this client wait already"):
            bus.recv(1.0)
            bus.twin.run(1.0)
        assert bus.twin._timers == []


def test_a_message_that_can_not_be_sent_was_no_error_of_python_can() -> None:
    with TwinBus(calibrated=False) as bus:
        for kind in (can.CanOperationError, plumb.Error):
            with pytest.raises(kind, match="too many frames of this client wait already"):
                for _ in range(1000):
                    bus.send(SYNC)
            with pytest.raises(kind, match="this is no CAN frame"):
                bus.send(can.Message(arbitration_id=0x801, is_extended_id=False, check=False))


def test_a_bus_that_was_shut_down_took_messages_and_gave_old_ones() -> None:
    twin = plumb.Twin(calibrated=False)
    bus = TwinBus(twin)
    twin.run(1.0)
    bus.shutdown()
    bus.shutdown()
    for what in (lambda: bus.send(SYNC), lambda: bus.recv(0.1), lambda: bus.send_periodic(SYNC, 1)):
        with pytest.raises(can.CanOperationError, match="^the bus was shut down"):
            what()
    assert twin.now_s == 1.0 and twin._timers == []


def test_words_of_python_can_beside_those_of_the_twin() -> None:
    with can.Bus(interface="plumb", bitrate=125_000, calibrated=False) as bus:
        boot = bus.recv(1.0)
    with TwinBus(bit_rate=125, calibrated=False) as bus:
        assert bus.recv(1.0).timestamp == boot.timestamp
    twin = plumb.Twin(calibrated=False)
    for words in ({"seed": 99}, {"bitrate": 250_000}):
        with pytest.raises(plumb.Error, match="can't be given beside a Twin"):
            TwinBus(twin, **words)
    with pytest.raises(plumb.Error, match="^give either bitrate"):
        TwinBus(bitrate=250_000, bit_rate=250)
    with pytest.raises(plumb.Error, match="^bitrate is 250 bit/s: give a whole number of kbit/s"):
        TwinBus(bitrate=250)


@pytest.mark.parametrize(
    ("what", "words"),
    [
        # They had names of the command line, and not what is allowed.
        (
            lambda: plumb.Twin(mode="fancy"),
            "mode is fancy: take product, dynamic, paper or one-axis",
        ),
        (lambda: plumb.Twin(seed=-1), "seed is -1: give a whole number from 0 to 2^64 - 1"),
        (lambda: plumb.Twin(seed=2**64), "give a whole number from 0 to 2^64 - 1"),
        (lambda: plumb.Twin(seed="a"), "seed is 'a': give a whole number"),
        (lambda: plumb.Twin(bit_rate=7), "bit_rate is 7: take one of [10, "),
        (lambda: plumb.Twin(bit_rate=None), "bit_rate is None: give a whole number"),
        (lambda: plumb.Twin(chamber_speed=0), "chamber_speed is 0: take a factor from 1 to 300"),
        (lambda: plumb.Twin(node_ids="1,2"), "node_ids: '1,2' is no list of node-ids"),
        (lambda: plumb.Twin(node_ids=[0, 1]), "node_ids: 0 is no node-id: give 1 to 127"),
        (lambda: plumb.Twin(node_ids=[1, 1]), "node_ids is 1,1: each node-id may be given once"),
        (lambda: plumb.Twin(node_ids=[1]), "1 node-id for 2 nodes"),
        (lambda: plumb.Twin(instruments=99), "instruments is 99: give 1 to 20"),
        (lambda: plumb.Twin(instruments=0), "instruments is 0: give 1 to 20"),
        (lambda: plumb.Twin(calibrated=False).say("levitate"), 'there is no word "levitate"'),
        (lambda: plumb.Twin(calibrated=False).say("pitch 300"), "write pitch DEGREES"),
        (lambda: plumb.Twin(calibrated=False).send(0x800), "this is no CAN frame"),
        (lambda: plumb.Twin(calibrated=False).send(1, bytes(9)), "this is no CAN frame"),
        (lambda: plumb.Twin(calibrated=False).send(-1), "-1 is no identifier"),
        (lambda: plumb.Twin(calibrated=False).run(-1.0), "seconds is a time from 0 on"),
        (lambda: plumb.Twin(calibrated=False).run(float("nan")), "seconds is a time from 0 on"),
        (lambda: plumb.Twin(calibrated=False).run_until(float("inf")), "time_s is a time from"),
        # It was an OverflowError.
        (lambda: plumb.Twin(calibrated=False).run(1e300), "seconds is 1e+300 s: give at most 31"),
        (lambda: plumb.Twin(calibrated=False).run_until(1e10), "time_s is 10000000000.0 s: give"),
        (lambda: TwinBus(calibrated=False).recv(float("nan")), "timeout is a time from 0 on"),
        # They did nothing.
        (lambda: plumb.Twin(calibrated=False).say("quit"), "quit ends the program plumb serve"),
        (lambda: plumb.Twin(calibrated=False).say("+1 s quit # now"), "quit ends the program"),
        (
            lambda: plumb.Twin(calibrated=False).wait_for(lambda _: True, -1.0),
            "timeout_s is a time from 0 on",
        ),
        (
            lambda: plumb.Twin(calibrated=False).wait_for(lambda _: False, 1.0, step_s=0.0),
            "step_s is a time of 1 ns or more",
        ),
    ],
)
def test_what_is_wrong_is_told_in_a_sentence(what, words: str) -> None:
    with pytest.raises(plumb.Error) as told:
        what()
    assert words in str(told.value) and "\n" not in str(told.value), told.value
    assert "--" not in str(told.value), told.value


def test_a_client_that_floods_is_stopped() -> None:
    twin = plumb.Twin(calibrated=False)
    with pytest.raises(plumb.Error, match="too many frames"):
        for _ in range(1000):
            twin.send(0x7FF, bytes(8))
    twin.run(1.0)
    twin.send(0x7FF, bytes(8))


def test_a_chain_follows_the_gyroscope_by_the_calibration_of_a_node() -> None:
    import canopen

    twin = plumb.Twin(mode="dynamic", seed=4)
    network = canopen.Network(bus=TwinBus(twin))
    network.connect()
    try:
        node = network.add_node(A, canopen.ObjectDictionary())
        calibration = node.sdo.upload(0x2061, 0)
    finally:
        network.disconnect()
    chain = plumb.Chain(calibration, "dynamic")
    assert chain.calibration == calibration and chain.deg_s_per_count == pytest.approx(0.0175)
    # Ten seconds at rest, with the noise of a living part; then half a second of 20 deg/s that
    # gravity does not show.
    noise = np.random.default_rng(1).integers(-4, 5, (2, 4170, 3)).astype(np.int16)
    counts, rates = chain.counts([0.0, 0.0, 1.0]) + noise[0], noise[1]
    still = chain.run(counts, temperature_degc=25.0, rates=rates)
    assert still.valid[-1].all() and still.read_us[-1] - still.at_us[-1, 0] == 5_000
    chain.reset()
    rates[-208:, :2] += round(20.0 / chain.deg_s_per_count)
    turned = chain.run(counts, temperature_degc=25.0, rates=rates)
    moved = np.abs(turned.angle_deg[-1] - still.angle_deg[-1])
    assert moved.max() > 5.0, moved


def test_a_wait_went_on_for_an_hour_after_the_bus_was_shut_down() -> None:
    bus = TwinBus(plumb.Twin(calibrated=False))
    # A message of its own ends nothing: it goes out and comes to others only.
    bus.set_filters([{"can_id": 0x7DF, "can_mask": 0x7FF}])
    found: list[str] = []

    def wait() -> None:
        with pytest.raises(can.CanOperationError) as told:
            bus.recv(None)
        found.append(str(told.value))

    waiting = threading.Thread(target=wait)
    waiting.start()
    began_s = bus.twin.now_s
    while bus.twin.now_s < began_s + 0.5:
        time.sleep(0.01)
    bus.shutdown()
    waiting.join()
    assert found == ["the bus was shut down: open another one"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_fork_waited_for_ever_for_the_twin_of_its_parent() -> None:
    twin = plumb.Twin(calibrated=False)
    child = os.fork()
    if child == 0:
        try:
            twin.run(1.0)
            os._exit(1)
        except plumb.Error as error:
            os._exit(0 if "make one in each" in str(error) else 2)
    end = time.monotonic() + 60.0
    while (done := os.waitpid(child, os.WNOHANG)) == (0, 0) and time.monotonic() < end:
        time.sleep(0.05)
    if done == (0, 0):
        os.kill(child, signal.SIGKILL)
        done = os.waitpid(child, 0)
    assert done == (child, 0)
    assert twin.run(1.0)
