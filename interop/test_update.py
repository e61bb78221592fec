"""Block download, and a new program by it: 1F50h to 1F57h (CiA 302-3) and 2080h."""

from __future__ import annotations

import itertools
import pathlib
import signal
import struct
import subprocess
import zlib
from typing import Callable, Iterator

import canopen
import pytest
from master import PATIENCE, PLUMB, START, Master, Plumb, until
from test_sdo import abort, ask, begin, crc, reason, unanswered

pytestmark = pytest.mark.virtual("its images are programs of the simulation")

CRC, MEMORY, LENGTH, TOO_SHORT = 0x0504_0004, 0x0504_0005, 0x0607_0010, 0x0607_0013
UNFIT, CANNOT_STORE, LOCAL, WRONG_STATE = 0x0604_0043, 0x0800_0020, 0x0800_0021, 0x0800_0022
STOP_PROGRAM, START_PROGRAM, CLEAR_PROGRAM = 0, 1, 3
REQUEST = 0x601
HEADER, FIELDS = 512, 96
BODY = bytes(i * i >> 3 & 0xFF for i in range(48 * 1024))
VERSION, SLOT, STANDING, UNDER_WAY, HELD = 2, 3, 4, 5, 6

Build = Callable[..., dict[int, bytes]]


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb("--uncalibrated") as plumb:
        yield plumb


@pytest.fixture
def master(joined: Master) -> Master:
    """A master of both nodes, fresh from a reset, with programs that are confirmed."""
    joined.reboot()
    until(lambda: joined.read(1, 0x2080, STANDING) != 1, "confirmation", 20)
    return joined


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> Build:
    """Builds images with a body, by slot, each of a later version than the one before."""
    folder = tmp_path_factory.mktemp("images")
    later = itertools.count(1)

    def build(body: bytes, *more: str, version: str = "") -> dict[int, bytes]:
        file, part = folder / "image", folder / "body"
        part.write_bytes(body)
        version = version or f"1.0.{next(later)}"
        command = [PLUMB, "image", file, "--force", "--version", version]
        command += ["--a", part, "--b", part, *more]
        subprocess.run(command, check=True)
        both = pathlib.Path(file).read_bytes()
        return {0: both[: len(both) // 2], 1: both[len(both) // 2 :]}

    return build


def clear(master: Master) -> None:
    """Stop, clear, and wait until the memory is ready."""
    for command in (STOP_PROGRAM, CLEAR_PROGRAM):
        master.write(1, 0x1F51, 1, command)
    until(lambda: not master.read(1, 0x1F57, 1) & 1, "a clear memory", 15)


@pytest.fixture
def cleared(master: Master) -> Master:
    """A node that waits for a program; a reset makes it forget that."""
    clear(master)
    assert (master.read(1, 0x1F51, 1), master.read(1, 0x1F57, 1)) == (3, 1 << 1)
    return master


def free(master: Master, images: dict[int, bytes]) -> bytes:
    """The image for the slot that does not run."""
    return images[1 - master.read(1, 0x2080, SLOT)]


def program(master: Master, image: bytes, **options: object) -> None:
    """Downloads an image in blocks as python-canopen does."""
    sdo = master.nodes[1].sdo
    stream = sdo.open(0x1F50, 1, "wb", size=len(image), block_transfer=True, **options)
    stream.write(image)
    stream.close()


def under_way(file: bytes) -> int:
    """2080h sub 5: over header and signature, without the sum that the header ends with."""
    return zlib.crc32(file[:28] + file[32:FIELDS])


def identity(image: bytes) -> int:
    """The check sum that the image's header holds."""
    return struct.unpack_from("<I", image, 24)[0]


def test_a_program_of_48_kb_by_blocks(cleared: Master, build: Build) -> None:
    image = free(cleared, build(BODY))
    before = cleared.read(1, 0x2080, SLOT)
    program(cleared, image)
    assert cleared.read(1, 0x1F56, 1) == identity(image)
    assert (cleared.read(1, 0x1F51, 1), cleared.read(1, 0x1F57, 1)) == (0, 0)
    mark = cleared.mark()
    cleared.write(1, 0x1F51, 1, START_PROGRAM)
    cleared.next(0x701, mark, data=lambda data: data == b"\0")
    assert cleared.read(1, 0x1F51, 1) == 1
    assert cleared.read(1, 0x1F56, 1) == identity(image)
    assert cleared.read(1, 0x2080, SLOT) == 1 - before
    assert cleared.read(1, 0x2080, VERSION) == struct.unpack_from("<I", image, 12)[0]
    until(lambda: cleared.read(1, 0x2080, STANDING) == 0, "confirmation", 10)
    cleared.reboot(1)
    assert cleared.read(1, 0x2080, SLOT) == 1 - before


# 888 and 1776 bytes fill one block and two but for a byte; all remainders of segments occur.
@pytest.mark.parametrize("length", [516, 520, 524, 528, 532, 536, 540, 888, 892, 1776, 1780])
def test_lengths_around_segments_and_blocks(cleared: Master, build: Build, length: int) -> None:
    image = free(cleared, build(BODY[: length - HEADER]))
    assert len(image) == length
    program(cleared, image)
    assert cleared.read(1, 0x1F56, 1) == identity(image)


def test_a_program_by_segments_works_too(cleared: Master, build: Build) -> None:
    image = free(cleared, build(BODY[:1000]))
    cleared.nodes[1].sdo.download(0x1F50, 1, image, force_segment=True)
    assert cleared.read(1, 0x1F56, 1) == identity(image)


def test_a_program_needs_a_stop_and_a_clear(master: Master, build: Build) -> None:
    with pytest.raises(canopen.SdoAbortedError) as refused:
        program(master, free(master, build(BODY[:100])))
    assert refused.value.code == WRONG_STATE
    assert master.read(1, 0x1F57, 1) == 4 << 1


def test_a_clear_takes_its_time_and_the_node_answers_meanwhile(master: Master) -> None:
    for command in (STOP_PROGRAM, CLEAR_PROGRAM):
        master.write(1, 0x1F51, 1, command)
    assert master.read(1, 0x1F57, 1) == 1
    assert master.refusal(1, 0x1F51, 1, bytes([STOP_PROGRAM])) == WRONG_STATE
    answer = ask(master, begin(0xC6, 0x1F50, 1, struct.pack("<I", 600)))
    assert reason(answer) == WRONG_STATE
    until(lambda: master.read(1, 0x1F57, 1) == 1 << 1, "a clear memory", 15)


def test_a_program_that_does_not_fit_is_refused_at_its_announcement(cleared: Master) -> None:
    answer = ask(cleared, begin(0xC6, 0x1F50, 1, struct.pack("<I", 1 << 24)))
    assert reason(answer) == MEMORY


def test_what_cannot_run_here_is_refused_with_its_reason(master: Master, build: Build) -> None:
    def outcome(image: bytes) -> tuple[int, int]:
        clear(master)
        with pytest.raises(canopen.SdoAbortedError) as refused:
            master.nodes[1].sdo.download(0x1F50, 1, image, force_segment=True)
        # python-canopen goes on to close the stream, which is refused as well.
        first = refused.value.__context__ or refused.value
        return first.code, master.read(1, 0x1F57, 1)

    runs = master.read(1, 0x2080, SLOT)
    good = build(BODY[:100])
    assert outcome(good[runs]) == (UNFIT, 2 << 1 | 2 << 16)
    other = build(BODY[:100], "--hardware", "1")
    assert outcome(free(master, other)) == (UNFIT, 2 << 1 | 1 << 16)
    older = build(BODY[:100], version="0.0.1")
    assert outcome(free(master, older)) == (LOCAL, 7 << 1 | 3 << 16)
    bare = build(BODY[:100], "--unsigned")
    assert outcome(free(master, bare)) == (LOCAL, 7 << 1 | 4 << 16)
    damaged = bytearray(free(master, good))
    damaged[-1] ^= 1
    assert outcome(bytes(damaged)) == (CANNOT_STORE, 3 << 1)


def test_a_wrong_signature_is_found_at_the_start(cleared: Master, build: Build) -> None:
    forged = bytearray(free(cleared, build(BODY)))
    forged[40] ^= 1
    program(cleared, bytes(forged))
    cleared.write(1, 0x1F51, 1, START_PROGRAM)
    # The node is busy with it, and answers.
    assert cleared.read(1, 0x1F57, 1) == 1
    assert cleared.refusal(1, 0x1F51, 1, bytes([START_PROGRAM])) == WRONG_STATE
    assert cleared.read(1, 0x1F56, 1) == identity(bytes(forged))
    until(lambda: cleared.read(1, 0x1F57, 1) != 1, "an end of the check", 5)
    assert cleared.read(1, 0x1F57, 1) == 7 << 1 | 5 << 16
    assert cleared.read(1, 0x1F51, 1) == 0


def begin_block_download(master: Master, size: int) -> None:
    answer = ask(master, begin(0xC6, 0x1F50, 1, struct.pack("<I", size)))
    assert answer[0] == 0xA4 and answer[4] == 127


def block(master: Master, image: bytes, count: int) -> int:
    """The first block of an image, of which only `count` segments are sent; those that arrived."""
    begin_block_download(master, len(image))
    for number in range(1, count):
        master.send(REQUEST, bytes([number]) + image[7 * number - 7 : 7 * number])
    last = bytes([count | 0x80]) + image[7 * count - 7 : 7 * count]
    answer = ask(master, last)
    assert answer[0] == 0xA2
    return answer[1]


def test_a_wrong_crc_ends_a_block_download(cleared: Master, build: Build) -> None:
    image = free(cleared, build(BODY[:20]))
    assert block(cleared, image, 76) == 76
    wrong = struct.pack("<BH", 0xC1, crc(image) ^ 1)
    assert reason(ask(cleared, wrong)) == CRC
    # Nothing of it counts, and a start is refused.
    assert cleared.read(1, 0x1F57, 1) == 3 << 1
    assert cleared.refusal(1, 0x1F51, 1, b"\x01") == WRONG_STATE


def test_a_lost_segment_is_told_and_taken_again(cleared: Master, build: Build) -> None:
    image = free(cleared, build(BODY[:20]))
    begin_block_download(cleared, len(image))
    # The second segment comes without the first: none has arrived in order.
    assert ask(cleared, b"\xff" + image[7:14])[:2] == b"\xa2\0"
    for number in range(1, 76):
        cleared.send(REQUEST, bytes([number]) + image[7 * number - 7 : 7 * number])
    assert ask(cleared, bytes([76 | 0x80]) + image[525:532])[:2] == b"\xa2\x4c"
    assert ask(cleared, struct.pack("<BH", 0xC1, crc(image)))[0] == 0xA1
    assert cleared.read(1, 0x1F56, 1) == identity(image)


def test_a_download_that_was_broken_off_goes_on(cleared: Master, build: Build) -> None:
    image = free(cleared, build(BODY[:2000]))
    assert block(cleared, image, 60) == 60
    unanswered(cleared, abort(0x0800_0000, 0x1F50, 1))
    assert cleared.read(1, 0x1F57, 1) == 3 << 1
    assert cleared.read(1, 0x2080, UNDER_WAY) == under_way(image)
    held = cleared.read(1, 0x2080, HELD)
    # The last segment is held back until it is known how much of it counts.
    assert held == 59 * 7
    cleared.write(1, 0x2080, HELD, held)
    program(cleared, image[held:])
    assert cleared.read(1, 0x1F56, 1) == identity(image)
    mark = cleared.mark()
    cleared.write(1, 0x1F51, 1, START_PROGRAM)
    cleared.next(0x701, mark, data=lambda data: data == b"\0")
    assert cleared.read(1, 0x1F56, 1) == identity(image)


def test_fewer_bytes_than_announced_are_refused(cleared: Master, build: Build) -> None:
    image = free(cleared, build(BODY[:20]))
    begin_block_download(cleared, len(image) + 1)
    ask(cleared, b"\x81" + image[:7])
    assert reason(ask(cleared, struct.pack("<BH", 0xC1, crc(image[:7])))) == LENGTH


def test_an_empty_download_is_refused(cleared: Master) -> None:
    assert ask(cleared, begin(0x21, 0x1F50, 1, bytes(4)))[0] == 0x60
    assert ask(cleared, b"\x0f") == abort(TOO_SHORT, 0x1F50, 1)
    assert ask(cleared, begin(0x40, 0x1000))[0] == 0x43


def test_a_program_is_not_taken_in_operational(master: Master) -> None:
    master.nmt(START, 1)
    assert master.refusal(1, 0x1F51, 1, b"\0") == WRONG_STATE
    assert master.read(1, 0x1F51, 1) == 1


def test_the_other_channel_measures_all_the_while(master: Master, build: Build) -> None:
    until(lambda: master.read(2, 0x2020) & 3 == 3, "angles of node 2", 10)
    clear(master)
    image, valid = free(master, build(BODY[:4000])), []
    for _ in range(5):
        clear(master)
        valid.append(master.read(2, 0x2020) & 3)
        program(master, image)
        valid.append(master.read(2, 0x2020) & 3)
    assert valid == [3] * 10


LATER = itertools.count(1)


@pytest.fixture
def image(tmp_path: pathlib.Path) -> Callable[..., pathlib.Path]:
    """Builds files for `plumb update`, each of a later version, with a body that takes a while."""

    def image(*more: str) -> pathlib.Path:
        file, part = tmp_path / f"image-{next(LATER)}", tmp_path / "body"
        part.write_bytes(BODY)
        version = f"2.0.{next(LATER)}"
        command = [PLUMB, "image", file, "--version", version, "--a", part, "--b", part, *more]
        subprocess.run(command, check=True)
        return file

    return image


def update(plumb: Plumb, image: pathlib.Path, *more: str) -> subprocess.Popen[str]:
    """`plumb update` under way."""
    command = [PLUMB, "update", image, "--bus", f"127.0.0.1:{plumb.port}", *more]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def ended(running: subprocess.Popen[str], master: Master, timeout: float) -> tuple[str, str]:
    """What the program has printed until its end; the master has then received its answers."""
    printed = running.communicate(timeout=PATIENCE * timeout)
    master.settle()
    return printed


def halves(file: pathlib.Path) -> list[bytes]:
    """The images in a file, for slot A and B."""
    both = file.read_bytes()
    return [both[: len(both) // 2], both[len(both) // 2 :]]


def segments(master: Master, mark: int) -> int:
    """Segments of block downloads to node 1 since the mark, roughly."""
    return sum(1 for f in master.since(mark, REQUEST) if f.data[0] in range(1, 0x20))


def state(master: Master) -> int:
    """Node 1's NMT state as its next heartbeat tells it."""
    master.settle()
    return master.next(0x701, master.mark()).data[0]


@pytest.fixture
def working(master: Master) -> Iterator[Master]:
    """Both nodes OPERATIONAL, and SYNC runs. Without calibration they may disagree there, so an
    update needs --force."""
    master.nmt(START)
    master.network.sync.start(0.02)
    assert state(master) == 5
    yield master
    master.network.sync.stop()


def test_an_interrupted_update_left_the_node_in_pre_operational(
    plumb: Plumb, working: Master, image: Callable[..., pathlib.Path]
) -> None:
    file, mark = image(), working.mark()
    running = update(plumb, file, "--nodes", "1", "--force")
    until(lambda: segments(working, mark) > 100, "segments", 15)
    running.send_signal(signal.SIGINT)
    _, said = ended(running, working, 10)
    assert running.returncode == 2 and "interrupted" in said
    working.next(REQUEST, mark, data=lambda data: data == abort(0x0504_0000, 0x1F50, 1))
    assert state(working) == 5
    # The next client's first request is answered.
    fields = free(working, dict(enumerate(halves(file))))[:FIELDS]
    assert working.read(1, 0x2080, UNDER_WAY) == under_way(fields)
    running = update(plumb, file, "--nodes", "1", "--force")
    out, said = ended(running, working, 40)
    assert running.returncode == 0, said
    assert out.startswith("node 1 continues after ")
    assert state(working) == 5


def test_another_image_with_the_same_body_went_on_where_one_had_stopped(
    plumb: Plumb, working: Master, image: Callable[..., pathlib.Path]
) -> None:
    mark = working.mark()
    running = update(plumb, image(), "--nodes", "1", "--force")
    until(lambda: segments(working, mark) > 100, "segments", 15)
    running.send_signal(signal.SIGINT)
    ended(running, working, 10)
    other = image()
    running = update(plumb, other, "--nodes", "1", "--force")
    out, said = ended(running, working, 40)
    assert running.returncode == 0, said
    assert "continues" not in out
    version = struct.unpack_from("<I", other.read_bytes(), 12)[0]
    assert working.read(1, 0x2080, VERSION) == version


def test_a_refused_update_left_the_node_in_pre_operational(
    plumb: Plumb, working: Master, image: Callable[..., pathlib.Path]
) -> None:
    running = update(plumb, image("--unsigned"), "--nodes", "1", "--force")
    _, said = ended(running, working, 20)
    assert running.returncode == 1 and "it is not signed" in said
    assert state(working) == 5


def test_an_update_started_while_the_other_channel_was_down(
    plumb: Plumb, master: Master, image: Callable[..., pathlib.Path]
) -> None:
    for node in (1, 2):
        until(lambda: master.read(node, 0x2020) & 3 == 3, "angles", 10)
    before, mark = master.read(1, 0x2080, VERSION), master.mark()
    running = update(plumb, image())
    until(lambda: segments(master, mark) > 100, "segments", 15)
    plumb.type("fault b silent")
    try:
        _, said = ended(running, master, 40)
    finally:
        plumb.type("heal b")
    assert running.returncode == 2 and "node 2 has no valid angle" in said
    assert master.read(1, 0x2080, VERSION) == before
    assert state(master) == 127


def test_an_update_ended_by_another_one_did_not_report_it(
    plumb: Plumb, working: Master, image: Callable[..., pathlib.Path]
) -> None:
    mark = working.mark()
    older = update(plumb, image(), "--nodes", "1", "--force")
    until(lambda: segments(working, mark) > 100, "segments", 15)
    newer = update(plumb, image(), "--nodes", "1", "--force")
    _, said = ended(older, working, 20)
    assert older.returncode == 2 and "another tool uses node 1" in said
    out, said = ended(newer, working, 40)
    assert newer.returncode == 0, said
