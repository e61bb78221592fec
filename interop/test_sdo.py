"""SDO server: expedited, segmented and block transfer, and what it refuses (CiA 301, SDO)."""

from __future__ import annotations

import binascii
import struct
from typing import Iterator

import pytest
from master import START, STOP, Master, Plumb, until

TOGGLE, TIMEOUT, COMMAND, BLOCK_SIZE = 0x0503_0000, 0x0504_0000, 0x0504_0001, 0x0504_0002
SEQUENCE = 0x0504_0003
WRITE_ONLY, READ_ONLY, NO_OBJECT, NO_SUB = 0x0601_0001, 0x0601_0002, 0x0602_0000, 0x0609_0011
TOO_LONG, TOO_SHORT = 0x0607_0012, 0x0607_0013
BAD_VALUE, TOO_HIGH, NO_DATA = 0x0609_0030, 0x0609_0031, 0x0800_0024
WRONG_STATE, CANNOT_STORE = 0x0800_0022, 0x0800_0020
REQUEST, ANSWER = 0x601, 0x581
NAME = b"Plumb inclinometer"


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb("--uncalibrated") as plumb:
        yield plumb


@pytest.fixture
def master(joined: Master) -> Master:
    """A master of both nodes, fresh from a reset; nothing here needs valid angles."""
    joined.reboot()
    return joined


def ask(master: Master, request: bytes) -> bytes:
    """One request as it stands, filled up with zeros; the answer."""
    mark = master.mark()
    master.send(REQUEST, request.ljust(8, b"\0"))
    return bytes(master.next(ANSWER, mark).data)


def begin(command: int, index: int, sub: int = 0, rest: bytes = b"") -> bytes:
    """A request that names an object."""
    return struct.pack("<BHB", command, index, sub) + rest


def abort(code: int, index: int, sub: int = 0) -> bytes:
    """The abort that names this object."""
    return struct.pack("<BHBI", 0x80, index, sub, code)


def reason(answer: bytes) -> int:
    """The code of an answer that is an abort."""
    assert answer[0] == 0x80, answer.hex(" ")
    return struct.unpack("<I", answer[4:])[0]


def unanswered(master: Master, request: bytes) -> None:
    """Sends a frame that must get no answer."""
    mark = master.mark()
    master.send(REQUEST, request)
    master.rest(0.05)
    assert not master.since(mark, ANSWER)


# Expedited and segmented.


def test_expedited_upload_tells_its_size(master: Master) -> None:
    assert ask(master, begin(0x40, 0x1000)) == begin(0x43, 0x1000, 0, b"\x9a\x01\x04\x30")
    assert ask(master, begin(0x40, 0x1017)) == begin(0x4B, 0x1017, 0, b"\xc8\0\0\0")
    assert ask(master, begin(0x40, 0x2002)) == begin(0x4F, 0x2002, 0, bytes(4))
    assert ask(master, begin(0x40, 0x2010, 1))[0] == 0x47


@pytest.mark.parametrize("command", [0x2B, 0x22], ids=["with size", "without size"])
def test_expedited_download_with_and_without_size(master: Master, command: int) -> None:
    answer = ask(master, begin(command, 0x1017, 0, b"\x2c\x01"))
    assert answer == begin(0x60, 0x1017, 0, bytes(4))
    assert master.read(1, 0x1017) == 300


def test_segmented_upload_segment_by_segment(master: Master) -> None:
    assert ask(master, begin(0x40, 0x1008)) == begin(0x41, 0x1008, 0, bytes([len(NAME), 0, 0, 0]))
    assert ask(master, b"\x60") == b"\x00" + NAME[:7]
    assert ask(master, b"\x70") == b"\x10" + NAME[7:14]
    assert ask(master, b"\x60") == b"\x07" + NAME[14:] + bytes(3)


def test_segmented_download_of_a_number(master: Master) -> None:
    assert ask(master, begin(0x21, 0x1017, 0, b"\x02\0\0\0"))[0] == 0x60
    assert ask(master, b"\x0b\x5e\x01")[0] == 0x20
    assert master.read(1, 0x1017) == 350


def test_segmented_download_without_a_size(master: Master) -> None:
    assert ask(master, begin(0x20, 0x1006))[0] == 0x60
    assert ask(master, b"\x07\x10\x27\0\0")[0] == 0x20
    assert master.read(1, 0x1006) == 10_000


@pytest.mark.parametrize("index", [0x1008, 0x1009, 0x100A])
def test_strings_by_every_way_are_the_same(master: Master, index: int) -> None:
    sdo = master.nodes[1].sdo
    with sdo.open(index, 0, "rb", block_transfer=True) as stream:
        assert stream.read() == sdo.upload(index, 0)


def test_a_segment_may_be_late_but_not_by_more_than_the_time_out(master: Master) -> None:
    """25 ms, as another stack had it, is no patience for a master on a busy machine."""
    ask(master, begin(0x40, 0x1008))
    master.rest(1.0)
    assert ask(master, b"\x60")[0] == 0x00
    mark = master.mark()
    frame = master.next(ANSWER, mark, timeout=5)
    assert bytes(frame.data) == abort(TIMEOUT, 0x1008)


def test_a_wrong_toggle_bit_ends_the_transfer(master: Master) -> None:
    ask(master, begin(0x40, 0x1008))
    assert ask(master, b"\x70") == abort(TOGGLE, 0x1008)
    assert reason(ask(master, b"\x60")) == COMMAND


def test_another_transfer_gives_the_first_one_up(master: Master) -> None:
    ask(master, begin(0x40, 0x1008))
    assert ask(master, begin(0x40, 0x1000))[0] == 0x43
    assert reason(ask(master, b"\x60")) == COMMAND


# Refusals.


@pytest.mark.sheets("objects of presets and updates")
@pytest.mark.parametrize(
    "request_, code",
    [
        (begin(0x40, 0x5FFF), NO_OBJECT),
        (begin(0x23, 0x5FFF, 0, bytes(4)), NO_OBJECT),
        (begin(0x40, 0x1018, 9), NO_SUB),
        (begin(0x40, 0x1000, 1), NO_SUB),
        (begin(0x40, 0x1F50, 1), WRITE_ONLY),
        (begin(0x23, 0x1000, 0, bytes(4)), READ_ONLY),
        (begin(0x21, 0x1008, 0, b"\x04\0\0\0"), READ_ONLY),
        (begin(0x23, 0x1017, 0, bytes(4)), TOO_LONG),
        (begin(0x2F, 0x1017, 0, bytes(4)), TOO_SHORT),
        (begin(0x21, 0x1017, 0, b"\x09\0\0\0"), TOO_LONG),
        (begin(0x2B, 0x6000, 0, b"\x02\0"), BAD_VALUE),
        (begin(0x2F, 0x6011, 0, b"\x04"), TOO_HIGH),
        (begin(0x23, 0x1010, 1, b"evas"), CANNOT_STORE),
        (begin(0x2F, 0x1F51, 1, b"\x03"), WRONG_STATE),
        (begin(0x40, 0x1003, 8), NO_DATA),
    ],
)
def test_every_refusal_names_its_reason_and_its_object(
    master: Master, request_: bytes, code: int
) -> None:
    index, sub = struct.unpack("<HB", request_[1:4])
    answer = ask(master, request_)
    assert answer == abort(code, index, sub), f"{reason(answer):08X}"


@pytest.mark.parametrize("command", [0xE0, 0xFF, 0x60, 0x00, 0xA1, 0xA2, 0xC1])
def test_an_unknown_command_or_one_out_of_place_is_refused(master: Master, command: int) -> None:
    assert reason(ask(master, begin(command, 0x1000))) == COMMAND


def test_an_abort_is_not_answered_with_an_abort(master: Master) -> None:
    unanswered(master, abort(0x0800_0000, 0x1000))
    ask(master, begin(0x40, 0x1008))
    unanswered(master, abort(0x0800_0000, 0x1008))
    assert reason(ask(master, b"\x60")) == COMMAND


@pytest.mark.parametrize("length", range(8))
def test_a_short_frame_is_no_request(master: Master, length: int) -> None:
    unanswered(master, begin(0x40, 0x1000).ljust(8, b"\0")[:length])


@pytest.mark.sheets("objects of presets and updates")
def test_a_refused_write_changes_nothing(master: Master) -> None:
    assert master.refusal(1, 0x6000, 0, b"\x02\0") == BAD_VALUE
    assert master.refusal(1, 0x1017, 0, bytes(4)) == TOO_LONG
    assert (master.read(1, 0x6000), master.read(1, 0x1017)) == (10, 200)


def test_stopped_means_no_answer_at_all(master: Master) -> None:
    master.nmt(STOP, 1)
    unanswered(master, begin(0x40, 0x1000).ljust(8, b"\0"))
    master.nmt(START, 1)
    master.rest(0.02)
    assert ask(master, begin(0x40, 0x1000))[0] == 0x43


def test_a_transfer_does_not_outlive_stopped(master: Master) -> None:
    ask(master, begin(0x40, 0x1008))
    master.nmt(STOP, 1)
    master.nmt(START, 1)
    master.rest(0.02)
    assert reason(ask(master, b"\x60")) == COMMAND


def test_two_nodes_answer_each_for_itself(master: Master) -> None:
    mark = master.mark()
    for node in (1, 2):
        master.send(0x600 + node, begin(0x40, 0x1018, 2).ljust(8, b"\0"))
    codes = [bytes(master.next(0x580 + node, mark).data)[4:] for node in (1, 2)]
    assert codes == [b"\x01\0LP", b"\x02\0LP"]


# Block upload.


def block(master: Master, mark: int, count: int) -> list[bytes]:
    """The segments of a block that has begun since the mark."""
    until(lambda: len(master.since(mark, ANSWER)) >= count, f"{count} segments")
    return [bytes(frame.data) for frame in master.since(mark, ANSWER)]


def begin_block_upload(master: Master, index: int, size: int) -> bytes:
    return ask(master, begin(0xA4, index, 0, bytes([size])))


def crc(data: bytes) -> int:
    return binascii.crc_hqx(data, 0)


def test_block_upload_of_a_string_with_its_crc(master: Master) -> None:
    answer = begin_block_upload(master, 0x1008, 127)
    assert answer == begin(0xC6, 0x1008, 0, bytes([len(NAME), 0, 0, 0]))
    mark = master.mark()
    master.send(REQUEST, b"\xa3".ljust(8, b"\0"))
    segments = block(master, mark, 3)
    assert [segment[0] for segment in segments] == [1, 2, 0x83]
    assert b"".join(segment[1:] for segment in segments)[: len(NAME)] == NAME
    # Three bytes of the last segment are no data, and the check sum doesn't count them.
    end = ask(master, b"\xa2\x03\x7f")
    assert end[0] == 0xC1 | 3 << 2 and struct.unpack_from("<H", end, 1)[0] == crc(NAME)
    unanswered(master, b"\xa1".ljust(8, b"\0"))
    assert ask(master, begin(0x40, 0x1000))[0] == 0x43


def test_lost_segments_are_sent_again_as_often_as_asked(master: Master) -> None:
    begin_block_upload(master, 0x1008, 127)
    mark = master.mark()
    master.send(REQUEST, b"\xa3".ljust(8, b"\0"))
    block(master, mark, 3)
    # The first segment arrived; then, of the two that are left, none, and none once more.
    for received in (1, 0, 0):
        mark = master.mark()
        master.send(REQUEST, bytes([0xA2, received, 127]).ljust(8, b"\0"))
        again = block(master, mark, 2)
        assert [segment[0] for segment in again] == [1, 0x82]
        assert b"".join(segment[1:] for segment in again)[:11] == NAME[7:]
    mark = master.mark()
    master.send(REQUEST, b"\xa2\x02\x7f".ljust(8, b"\0"))
    end = bytes(master.next(ANSWER, mark).data)
    assert struct.unpack_from("<H", end, 1)[0] == crc(NAME)


@pytest.mark.parametrize("size", [0, 128, 255])
def test_a_block_size_that_does_not_exist_is_refused(master: Master, size: int) -> None:
    assert reason(begin_block_upload(master, 0x1008, size)) == BLOCK_SIZE


def test_an_acknowledgement_with_block_size_zero_is_refused(master: Master) -> None:
    begin_block_upload(master, 0x2061, 4)
    mark = master.mark()
    master.send(REQUEST, b"\xa3".ljust(8, b"\0"))
    block(master, mark, 4)
    assert reason(ask(master, b"\xa2\x04\x00")) == BLOCK_SIZE


def test_a_client_may_abort_in_the_middle_of_a_block_upload(master: Master) -> None:
    begin_block_upload(master, 0x2061, 4)
    mark = master.mark()
    master.send(REQUEST, b"\xa3".ljust(8, b"\0"))
    block(master, mark, 4)
    unanswered(master, abort(0x0800_0000, 0x2061))
    assert ask(master, begin(0x40, 0x1000))[0] == 0x43


@pytest.mark.parametrize("size", [1, 2, 3, 126, 127])
def test_the_calibration_by_blocks_of_any_size(master: Master, size: int) -> None:
    sdo = master.nodes[1].sdo
    whole = sdo.upload(0x2061, 0)
    answer = begin_block_upload(master, 0x2061, size)
    assert struct.unpack("<I", answer[4:])[0] == len(whole)
    got, mark = b"", master.mark()
    master.send(REQUEST, b"\xa3".ljust(8, b"\0"))
    left = -(-len(whole) // 7)
    while left:
        now = min(size, left)
        got += b"".join(segment[1:] for segment in block(master, mark, now))
        mark, left = master.mark(), left - now
        master.send(REQUEST, bytes([0xA2, now, size]).ljust(8, b"\0"))
    end = bytes(master.next(ANSWER, mark).data)
    assert got[: len(whole)] == whole
    assert struct.unpack_from("<H", end, 1)[0] == crc(whole)
    master.send(REQUEST, b"\xa1".ljust(8, b"\0"))
