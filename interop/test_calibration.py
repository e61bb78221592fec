"""Calibration over the bus: by a motor (2060h), and as data that a tool keeps (2061h, 2062h)."""

from __future__ import annotations

import zlib
from typing import Iterator

import canopen
import pytest
from master import ROOT, START, Master, Plumb, until


STORE_REFUSED, WRONG_STATE, TOO_LONG = 0x0800_0020, 0x0800_0022, 0x0607_0012
START_X, START_Y, FINISH, ABANDON = 1, 2, 3, 4
ANGLES = range(-60, 61, 20)

# Virtual seconds for each of the machine's: the filter of 2 Hz wants a second at each stand.
SPEED = 5


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb("--mode", "paper", "--speed", str(SPEED)) as plumb:
        yield plumb


@pytest.fixture(autouse=True)
def tables(master: Master) -> None:
    """The run of 2060h, which the paper's data sheet has and the product's has not."""
    for node, channel in (1, "a"), (2, "b"):
        sheet = canopen.import_od(str(ROOT / "eds" / f"plumb-paper-{channel}.eds"), node)
        objects = master.nodes[node].object_dictionary
        if 0x2060 not in objects:
            objects.add_object(sheet[0x2060])


@pytest.fixture
def delivered(plumb: Plumb, master: Master) -> Iterator[Master]:
    """A level housing, and afterwards the calibration that it was delivered with."""
    plumb.turn(0, 0, 400)
    before = upload(master)
    yield master
    master.write(1, 0x2060, 1, ABANDON)
    download(master, 1, before)


def upload(master: Master, node: int = 1) -> bytes:
    with master.nodes[node].sdo[0x2061].open("rb", block_transfer=True) as stream:
        return stream.read()


def download(master: Master, node: int, data: bytes, block: bool = False) -> int:
    """The abort code, 0 for none."""
    if not block:
        return master.refusal(node, 0x2061, 0, data)
    try:
        entry = master.nodes[node].sdo[0x2061]
        with entry.open("wb", size=len(data), block_transfer=True) as stream:
            stream.write(data)
    except canopen.SdoAbortedError as abort:
        return abort.code
    return 0


def identity(master: Master, node: int = 1) -> int:
    return master.read(node, 0x2062, 1)


def reference(master: Master, degrees: float) -> int:
    """Writes the angle of the motor; the abort code, 0 for none."""
    return master.refusal(1, 0x2060, 2, round(degrees * 1000).to_bytes(4, "little", signed=True))


def result(master: Master) -> int:
    return master.read(1, 0x2060, 8)


def stand(master: Master) -> None:
    """A second at a stand by the nodes' own time, 200 ms a heartbeat: a loaded machine lags."""
    mark = master.mark()
    until(lambda: len(master.since(mark, 0x701)) > 5, "six heartbeats")


def turn_axis(plumb: Plumb, master: Master, command: int) -> list[int]:
    """The motor's run of one axis: points at every stand; the residuals."""
    master.write(1, 0x2060, 1, command)
    residuals = []
    for count, degrees in enumerate(ANGLES, 1):
        pose = (0, degrees) if command == START_X else (degrees, 0)
        plumb.turn(*pose, 400)
        stand(master)
        assert reference(master, degrees) == 0, f"{degrees} deg, reason {result(master)}"
        assert master.read(1, 0x2060, 3 + command) == count
        residuals.append(master.read(1, 0x2060, 6))
    assert master.read(1, 0x2060, 7) == max(abs(residual) for residual in residuals)
    return residuals


def test_a_motor_calibrates_both_axes(plumb: Plumb, delivered: Master) -> None:
    before = identity(delivered)
    residuals = turn_axis(plumb, delivered, START_X)
    assert delivered.read(1, 0x2060, 3) == 1
    residuals += turn_axis(plumb, delivered, START_Y)
    assert delivered.read(1, 0x2060, 3) == 2
    # The tables as delivered have steps of a degree and straight lines between their points.
    print(f"largest residual {max(abs(residual) for residual in residuals)} thousandths of a degree")
    assert max(abs(residual) for residual in residuals) <= 300
    assert identity(delivered) == before, "nothing counts before it is finished"
    delivered.write(1, 0x2060, 1, FINISH)
    assert delivered.read(1, 0x2060, 3) == 0
    assert identity(delivered) != before
    assert delivered.read(1, 0x2062, 2) == 0
    assert [delivered.read(1, 0x2060, sub) for sub in (4, 5)] == [len(ANGLES)] * 2
    plumb.turn(20, 0, 400)
    stand(delivered)
    # Two tables of points 20 deg apart: at a point they read the point, and the sample's noise of
    # 0.04 deg, which reading the nearest point hid.
    assert delivered.read(1, 0x6020) == pytest.approx(2000, abs=25)
    after = identity(delivered)
    delivered.reset(1)
    assert identity(delivered) == after, "stored"


def test_a_run_that_is_abandoned_is_a_verification(plumb: Plumb, delivered: Master) -> None:
    before = upload(delivered)
    turn_axis(plumb, delivered, START_Y)
    delivered.write(1, 0x2060, 1, ABANDON)
    assert delivered.read(1, 0x2060, 3) == 0
    assert upload(delivered) == before
    assert delivered.read(1, 0x2060, 5) == len(ANGLES), "what it found stays readable"


def test_refused_commands_and_points_leave_their_reason(delivered: Master) -> None:
    before = identity(delivered)
    assert reference(delivered, 0) == WRONG_STATE and result(delivered) == 32, "no run"
    assert delivered.refusal(1, 0x2060, 1, bytes([FINISH])) == WRONG_STATE
    assert result(delivered) == 32
    assert delivered.refusal(1, 0x2060, 1, b"\x05") != 0
    delivered.write(1, 0x2060, 1, START_X)
    assert result(delivered) == 0
    assert reference(delivered, 91) == WRONG_STATE and result(delivered) == 33
    assert reference(delivered, 0) == 0 and result(delivered) == 0
    assert reference(delivered, 0) == WRONG_STATE and result(delivered) == 34, "the same angle"
    assert delivered.refusal(1, 0x2060, 1, bytes([FINISH])) == WRONG_STATE
    assert result(delivered) == 40, "one point makes no table"
    assert delivered.read(1, 0x2060, 3) == 1 and delivered.read(1, 0x2060, 4) == 1
    assert identity(delivered) == before


def test_no_calibration_in_operational(delivered: Master) -> None:
    data = upload(delivered)
    delivered.nmt(START, 1)
    assert delivered.refusal(1, 0x2060, 1, bytes([START_X])) == WRONG_STATE
    assert download(delivered, 1, data) == WRONG_STATE
    assert upload(delivered) == data, "reading is always allowed"
    delivered.nmt(0x80, 1)


def test_the_data_can_be_kept_and_carried_to_another_piece(delivered: Master) -> None:
    one, other = upload(delivered, 1), upload(delivered, 2)
    assert one != other
    for data, node in ((one, 1), (other, 2)):
        assert data[:4] == b"PLMC" and int.from_bytes(data[8:12], "little") == len(data)
        # The last word is the check sum of all before it, and 2062h is that word.
        check_sum = int.from_bytes(data[-4:], "little")
        assert zlib.crc32(data[:-4]) == check_sum == identity(delivered, node)
    for block in (True, False):
        assert download(delivered, 1, other, block) == 0
        assert upload(delivered, 1) == other
        assert identity(delivered, 1) == identity(delivered, 2)
        assert download(delivered, 1, one, block) == 0
        assert upload(delivered, 1) == one


def test_a_segmented_upload_gives_the_same_bytes_as_a_block_upload(delivered: Master) -> None:
    assert delivered.nodes[1].sdo.upload(0x2061, 0) == upload(delivered)


def test_data_that_are_damaged_are_refused_and_the_old_ones_stay(delivered: Master) -> None:
    data = upload(delivered)
    flipped = data[:100] + bytes([data[100] ^ 1]) + data[101:]
    alien = b"PLMD" + data[4:-4]
    alien += zlib.crc32(alien).to_bytes(4, "little")
    for what, bad in {
        "cut": data[:-1],
        "damaged": flipped,
        "empty": b"",
        "zeros": bytes(2000),
        "another format with the right check sum": alien,
    }.items():
        assert download(delivered, 1, bad) == STORE_REFUSED, what
        assert upload(delivered) == data, what
    assert download(delivered, 1, data + bytes(1000)) == TOO_LONG
    assert upload(delivered) == data
    delivered.reset(1)
    assert upload(delivered) == data, "after a reset as well"


def test_data_that_are_complete_but_not_plausible_are_refused(delivered: Master) -> None:
    data = upload(delivered)
    words = [int.from_bytes(data[i : i + 4], "little", signed=True) for i in range(0, len(data), 4)]
    first = len(words) - 2 * (1 + 2 * 181) - 1
    assert words[first] == 181, "points of table X"
    falling = list(words)
    falling[first + 2], falling[first + 4] = words[first + 4], words[first + 2]
    body = b"".join(word.to_bytes(4, "little", signed=True) for word in falling[:-1])
    assert download(delivered, 1, body + zlib.crc32(body).to_bytes(4, "little")) == STORE_REFUSED
    assert upload(delivered) == data


def test_an_upload_and_a_download_that_are_given_up_change_nothing(delivered: Master) -> None:
    data = upload(delivered)
    size = len(data).to_bytes(4, "little")
    mark = delivered.mark()
    delivered.send(0x601, b"\x21\x61\x20\x00" + size)
    delivered.next(0x581, mark, data=lambda d: d[0] == 0x60)
    mark = delivered.mark()
    delivered.send(0x601, b"\x00" + data[:7])
    delivered.next(0x581, mark, data=lambda d: d[0] == 0x20)
    delivered.send(0x601, b"\x80\x61\x20\x00\x00\x00\x04\x05")
    assert upload(delivered) == data


def test_a_run_and_a_download_do_not_mix(delivered: Master) -> None:
    data = upload(delivered)
    delivered.write(1, 0x2060, 1, START_X)
    assert download(delivered, 1, data) == WRONG_STATE
    assert delivered.read(1, 0x2060, 3) == 1, "the run goes on"
    delivered.write(1, 0x2060, 1, ABANDON)
    assert download(delivered, 1, data) == 0


HASH, NO_DATA = bytes(range(32)), 0x0800_0024


def report_hash(master: Master) -> bytes | int:
    """What 2063h holds, or its abort code."""
    try:
        return master.nodes[1].sdo.upload(0x2063, 0)
    except canopen.SdoAbortedError as abort:
        return abort.code


def test_a_report_belongs_to_the_calibration_in_force_only(delivered: Master) -> None:
    data = upload(delivered)
    assert download(delivered, 1, data) == 0
    assert delivered.refusal(1, 0x2063, 0, HASH) == 0
    assert report_hash(delivered) == HASH
    delivered.reset(1)
    assert report_hash(delivered) == HASH, "stored"
    # Another calibration: only the noise of its budget differs.
    body = data[:16] + b"\x01\x02\x03\x00" + data[20:-4]
    assert download(delivered, 1, body + zlib.crc32(body).to_bytes(4, "little")) == 0
    assert report_hash(delivered) == NO_DATA
    assert download(delivered, 1, data) == 0
    assert report_hash(delivered) == HASH, "the one that it belongs to is in force again"


def test_what_is_no_hash_is_refused_and_the_old_one_stays(delivered: Master) -> None:
    assert delivered.refusal(1, 0x2063, 0, HASH) == 0
    assert delivered.refusal(1, 0x2063, 0, HASH[:31]) == STORE_REFUSED
    assert delivered.refusal(1, 0x2063, 0, bytes(33)) == TOO_LONG
    delivered.write(1, 0x2060, 1, START_X)
    assert delivered.refusal(1, 0x2063, 0, HASH) == WRONG_STATE, "a run is open"
    delivered.write(1, 0x2060, 1, ABANDON)
    assert report_hash(delivered) == HASH
