"""CANopen Safety: SRDOs, their commissioning, and when they fall silent (EN 50325-5)."""

from __future__ import annotations

from typing import Iterator

import pytest
from master import INVALID16, PRE_OPERATIONAL, PROOF_S, START, STOP, Master, Plumb, signed, until

VALID = 0xA5
BAD_VALUE, INCOMPATIBLE = 0x0609_0030, 0x0604_0043
WRONG_STATE, UNSUPPORTED = 0x0800_0022, 0x0601_0000
ROLL, PITCH = -10.0, 30.0
PLAIN, INVERTED = {1: 0x101, 2: 0x103}, {1: 0x102, 2: 0x104}


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb("--speed", "4") as plumb:
        plumb.turn(PITCH, ROLL)
        yield plumb


def crc(data: bytes) -> int:
    """CRC-16-CCITT: polynomial 1021h, start 0, nothing reflected."""
    sum = 0
    for byte in data:
        sum ^= byte << 8
        for _ in range(8):
            sum = (sum << 1 ^ (0x1021 if sum & 0x8000 else 0)) & 0xFFFF
    return sum


def signature(
    direction: int, sct: int, srvt: int, cob_ids: tuple[int, int], mapping: list[int]
) -> int:
    """What a tool writes to 13FFh."""
    data = bytes([direction]) + sct.to_bytes(2, "little") + bytes([srvt])
    data += b"".join(cob.to_bytes(4, "little") for cob in cob_ids) + bytes([len(mapping)])
    for sub, entry in enumerate(mapping, 1):
        data += bytes([sub]) + entry.to_bytes(4, "little")
    return crc(data)


def read_signature(master: Master, node: int, srdo: int) -> int:
    """The signature over what the node has, computed here."""
    com, map = 0x1300 + srdo, 0x1380 + srdo
    header = [master.read(node, com, sub) for sub in (1, 2, 3, 5, 6)]
    entries = [master.read(node, map, sub) for sub in range(1, master.read(node, map, 0) + 1)]
    return signature(*header[:3], (header[3], header[4]), entries)


def u(number: int, size: int) -> bytes:
    return number.to_bytes(size, "little")


def commission(master: Master, node: int) -> None:
    """The procedure of docs/canopen.md."""
    for srdo in (1, 2):
        if master.read(node, 0x1300 + srdo, 1):
            master.write(node, 0x13FF, srdo, read_signature(master, node, srdo))
    master.write(node, 0x13FE, 0, VALID)
    master.write(node, 0x63FF, 1, crc(u(master.read(node, 0x6200), 2)))
    master.write(node, 0x63FE, 0, VALID)


def run(master: Master) -> None:
    """Starts the nodes, with SYNC by the lower one, until the pair agrees and shows its slopes."""
    for node in (1, 2):
        master.write(node, 0x2050, 1, 50)
    master.nmt(START)
    for node in (1, 2):
        until(lambda: master.read(node, 0x2021) == 1, f"agreement seen by node {node}", 5)
        # The slopes follow within 10 ms.
        until(lambda: master.read(node, 0x6010) != INVALID16, f"a slope of node {node}", 5)


@pytest.fixture
def running(master: Master) -> Master:
    """Both nodes commissioned and in OPERATIONAL."""
    for node in (1, 2):
        commission(master, node)
    run(master)
    return master


def test_the_check_sum_is_the_standards() -> None:
    assert crc(b"123456789") == 0x31C3


def test_the_published_vectors() -> None:
    entries = [0x6210_0108, 0x6211_0108, 0x6210_0208, 0x6211_0208]
    assert signature(1, 25, 20, (0x101, 0x102), entries) == 0xF2B5
    entries = [0x6210_0010, 0x6211_0010, 0x6220_0010, 0x6221_0010]
    assert signature(1, 25, 20, (0x101, 0x102), entries) == 0x93A3


def test_the_node_computes_the_vector_93a3_itself(master: Master) -> None:
    assert read_signature(master, 1, 1) == 0x93A3, "as delivered"
    # Away from it and back: nothing but 93A3h is taken then.
    master.write(1, 0x1301, 2, 26)
    assert master.refusal(1, 0x13FF, 1, u(0x93A3, 2)) == BAD_VALUE
    master.write(1, 0x1301, 2, 25)
    assert master.refusal(1, 0x13FF, 1, u(0x93A3, 2)) == 0
    assert master.refusal(1, 0x13FF, 1, u(0xF2B5, 2)) == BAD_VALUE
    assert master.read(1, 0x13FF, 1) == 0x93A3


def test_the_vector_f2b5_maps_what_this_device_has_not(master: Master) -> None:
    master.write(1, 0x1381, 0, 0)
    assert master.refusal(1, 0x1381, 1, u(0x6210_0108, 4)) == 0x0609_0011


def test_no_srdo_before_it_is_commissioned(master: Master) -> None:
    run(master)
    mark = master.mark()
    master.rest(0.2)
    assert not [f for f in master.frames[mark:] if 0x101 <= f.arbitration_id <= 0x180]


@pytest.mark.parametrize("left_out", ["13FEh", "63FEh"])
def test_both_configurations_must_be_valid(master: Master, left_out: str) -> None:
    commission(master, 1)
    master.write(1, {"13FEh": 0x13FE, "63FEh": 0x63FE}[left_out], 0, 0)
    run(master)
    mark = master.mark()
    master.rest(0.2)
    assert not master.since(mark, PLAIN[1])


def test_pairs_are_plain_and_bit_inverted_and_carry_the_angles(running: Master) -> None:
    mark = running.mark()
    running.rest(0.5)
    for node in (1, 2):
        pair = (PLAIN[node], INVERTED[node])
        plain = [bytes(f.data) for f in running.since(mark, PLAIN[node])]
        inverted = [bytes(f.data) for f in running.since(mark, INVERTED[node])]
        assert len(plain) >= 15 and abs(len(plain) - len(inverted)) <= 1
        both = [f for f in running.frames[mark:] if f.arbitration_id in pair]
        if both[0].arbitration_id == INVERTED[node]:
            inverted = inverted[1:]
        for data, twin in zip(plain, inverted):
            assert twin == bytes(b ^ 0xFF for b in data)
            x, y = signed(data)
            assert abs(x - ROLL * 100) < 25 and abs(y - PITCH * 100) < 25


def test_the_cycle_and_the_pairs_keep_their_times(running: Master) -> None:
    mark = running.mark()
    running.rest(1.0)
    for node in (1, 2):
        plain = [f.timestamp for f in running.since(mark, PLAIN[node])]
        inverted = [f.timestamp for f in running.since(mark, INVERTED[node])]
        assert len(plain) > 30
        # SCT 25 ms. At 250 kbit/s and with all stuff bits a frame of eight bytes under way may hold
        # one of them up for 0.54 ms, SYNC goes first for 0.22 ms, and node 1's pair, whose
        # identifiers are lower than node 2's, for 0.38 ms each. A consumer's SCT has to allow it.
        held_up = 0.00054 + 0.00022 + (2 * 0.00038 if node == 2 else 0)
        apart = max(b - a for a, b in zip(plain, plain[1:]))
        assert apart <= 0.025 + held_up, node
        later = [next((i - p for i in inverted if i > p), 0) for p in plain]
        assert max(later) < 0.020, "SRVT"


def test_the_safe_slope_has_neither_preset_nor_inversion(running: Master) -> None:
    running.write(1, 0x6012, 0, 0)
    running.write(1, 0x6021, 0, 3)
    mark = running.mark()
    x, y = signed(running.next(PLAIN[1], mark).data)
    assert abs(x - ROLL * 100) < 25 and abs(y - PITCH * 100) < 25


def test_a_wrong_signature_is_refused(master: Master) -> None:
    before = master.read(1, 0x13FF, 1)
    assert master.refusal(1, 0x13FF, 1, u(before ^ 1, 2)) == BAD_VALUE
    assert master.read(1, 0x13FF, 1) == before
    assert master.refusal(1, 0x63FF, 1, u(0x1234, 2)) == BAD_VALUE


@pytest.mark.parametrize(
    ("index", "sub", "value"),
    [(0x1301, 1, 0), (0x1301, 2, 50), (0x1301, 3, 10), (0x1302, 2, 30), (0x1381, 0, 0)],
)
def test_a_write_to_the_srdo_clears_13feh(master: Master, index: int, sub: int, value: int) -> None:
    commission(master, 1)
    master.write(1, index, sub, value)
    assert master.read(1, 0x13FE) == 0
    assert master.read(1, 0x63FE) == VALID


def test_13feh_is_refused_while_a_signature_does_not_fit(master: Master) -> None:
    master.write(1, 0x1301, 2, 50)
    assert master.refusal(1, 0x13FE, 0, bytes([VALID])) == INCOMPATIBLE
    assert master.read(1, 0x13FE) == 0
    master.write(1, 0x13FF, 1, read_signature(master, 1, 1))
    assert master.refusal(1, 0x13FE, 0, bytes([VALID])) == 0


def test_6200h_clears_63feh_which_is_refused_until_it_is_signed(master: Master) -> None:
    commission(master, 1)
    master.write(1, 0x6200, 0, 100)
    assert master.read(1, 0x63FE) == 0
    assert master.refusal(1, 0x63FE, 0, bytes([VALID])) == INCOMPATIBLE
    master.write(1, 0x63FF, 1, crc(u(100, 2)))
    assert master.refusal(1, 0x63FE, 0, bytes([VALID])) == 0


def test_what_would_make_no_safe_srdo_is_refused(master: Master) -> None:
    for sub, bad in ((1, 3), (3, 0), (4, 255)):
        assert master.refusal(1, 0x1301, sub, bytes([bad])) != 0, sub
    assert master.refusal(1, 0x1301, 2, bytes(2)) != 0, "SCT 0"
    for sub, bad in ((5, 0x102), (5, 0x181), (5, 0x0FF), (6, 0x101), (6, 0x182), (6, 0x100)):
        assert master.refusal(1, 0x1301, sub, u(bad, 4)) != 0, f"{bad:X}"
    assert master.refusal(1, 0x1381, 1, u(0x6220_0010, 4)) == UNSUPPORTED, "it is on"
    master.write(1, 0x1381, 0, 0)
    assert master.refusal(1, 0x1381, 1, u(0x6010_0010, 4)) == 0x0604_0041, "no safe object"
    assert master.refusal(1, 0x1381, 0, b"\x03") != 0, "half a pair"
    assert master.refusal(1, 0x1381, 0, b"\xC8") == 0x0604_0042


def test_identifiers_that_are_no_pair_are_never_valid(master: Master) -> None:
    master.write(1, 0x1301, 5, 0x111)
    master.write(1, 0x13FF, 1, read_signature(master, 1, 1))
    assert master.refusal(1, 0x13FE, 0, bytes([VALID])) == INCOMPATIBLE


def test_nothing_of_it_may_be_written_in_operational(running: Master) -> None:
    assert running.refusal(1, 0x1301, 2, u(50, 2)) == WRONG_STATE
    assert running.refusal(1, 0x13FE, 0, b"\x00") == WRONG_STATE
    assert running.refusal(1, 0x6200, 0, u(100, 2)) == WRONG_STATE
    for index, sub, data in (
        (0x1300, 0, b"\x01"),
        (0x1302, 1, b"\x02"),
        (0x1381, 0, b"\x00"),
        (0x13FF, 1, u(running.read(1, 0x13FF, 1), 2)),
        (0x63FE, 0, b"\x00"),
        (0x63FF, 1, u(running.read(1, 0x63FF, 1), 2)),
    ):
        assert running.refusal(1, index, sub, data) == WRONG_STATE, f"{index:X}"
    mark = running.mark()
    running.next(PLAIN[1], mark)


@pytest.mark.parametrize("command", [PRE_OPERATIONAL, STOP])
def test_srdos_go_out_in_operational_only(running: Master, command: int) -> None:
    running.next(PLAIN[1], running.mark())
    running.nmt(command, 1)
    running.rest(0.05)
    mark = running.mark()
    running.rest(0.1)
    assert not running.since(mark, PLAIN[1])


def test_a_fault_is_silence(plumb: Plumb, running: Master) -> None:
    running.next(PLAIN[2], running.mark())
    try:
        mark = running.mark()
        plumb.type("fault b stuck")
        running.next(0x082, mark)
        running.rest(0.05)
        mark = running.mark()
        running.rest(0.15)
        assert not running.since(mark, PLAIN[2]) and not running.since(mark, INVERTED[2])
    finally:
        plumb.type("heal b")


@pytest.mark.product("the paper's check warns for a while and names no channel")
def test_a_disagreement_is_silence_of_both(plumb: Plumb, running: Master) -> None:
    for node in (1, 2):
        running.next(PLAIN[node], running.mark())
    try:
        mark = running.mark()
        plumb.type("fault b offset 20")
        for node in (1, 2):
            running.next(0x080 + node, mark, data=lambda d: d[:2] == b"\x13\xff" and d[7] == 6)
        running.rest(0.05)
        mark = running.mark()
        running.rest(0.15)
        assert not [f for f in running.frames[mark:] if 0x101 <= f.arbitration_id <= 0x104]
    finally:
        plumb.type("heal b")


@pytest.mark.product("the paper's check warns for a while and names no channel")
def test_one_channel_alone_sends_no_safety_frame(plumb: Plumb, running: Master) -> None:
    running.next(PLAIN[1], running.mark())
    running.rest(PROOF_S)
    try:
        mark = running.mark()
        plumb.type("fault b brown-out")
        running.next(0x081, mark, data=lambda d: d[:2] == b"\x15\xff" and d[7] == 8)
        running.rest(0.05)
        assert running.read(1, 0x2020) & 3 == 3, "it measures on"
        mark = running.mark()
        running.rest(0.15)
        assert not running.since(mark, PLAIN[1]) and not running.since(mark, INVERTED[1])
    finally:
        plumb.type("heal b")


def test_gfc_is_obeyed_where_1300h_sets_it(master: Master) -> None:
    master.write(1, 0x1300, 0, 1)
    for node in (1, 2):
        commission(master, node)
    run(master)
    master.send(0x001)
    master.rest(0.1)
    mark = master.mark()
    master.rest(0.2)
    assert not master.since(mark, PLAIN[1]), "the safe state"
    assert master.since(mark, PLAIN[2]), "1300h is 0 there"


def test_a_node_takes_the_other_channels_srdo_and_reports_its_end(
    plumb: Plumb, master: Master
) -> None:
    master.write(1, 0x1302, 1, 2)
    for sub in (1, 2, 3, 4):
        master.write(1, 0x1382, sub, 0x2012_0010 | sub << 8)
    master.write(1, 0x1382, 0, 4)
    # It counts from the start on, and SYNC comes 50 ms after that.
    master.write(1, 0x1302, 2, 300)
    for node in (1, 2):
        commission(master, node)
    run(master)
    master.rest(0.2)
    x, twin = master.read(1, 0x2012, 1), master.read(1, 0x2012, 2)
    assert abs(x - ROLL * 100) < 25
    assert master.read(1, 0x2012, 3) == pytest.approx(PITCH * 100, abs=25)
    assert (twin ^ 0xFFFF) & 0xFFFF == pytest.approx(x & 0xFFFF, abs=20)
    mark = master.mark()
    master.nmt(PRE_OPERATIONAL, 2)
    emcy = master.next(0x081, mark, data=lambda d: d[:2] == b"\x17\xff")
    assert emcy.data[2] & 1
    master.rest(0.05)
    mark = master.mark()
    master.rest(0.1)
    assert not master.since(mark, PLAIN[1]), "a failed SRDO is a reason for silence"


def test_a_safety_frame_that_never_comes_is_told_and_ends_the_own_ones(master: Master) -> None:
    """Node 2 is not commissioned, so 103h and 104h never come."""
    master.write(1, 0x1302, 1, 2)
    for sub in (1, 2, 3, 4):
        master.write(1, 0x1382, sub, 0x2012_0010 | sub << 8)
    master.write(1, 0x1382, 0, 4)
    master.write(1, 0x1302, 2, 200)
    commission(master, 1)
    mark = master.mark()
    run(master)
    master.next(0x081, mark, data=lambda d: d[:2] == b"\x17\xff")
    master.rest(0.05)
    mark = master.mark()
    master.rest(0.2)
    assert not master.since(mark, PLAIN[1]) and not master.since(mark, INVERTED[1])


def test_safety_frames_do_not_begin_in_operational(master: Master) -> None:
    commission(master, 1)
    master.write(1, 0x63FE, 0, 0)
    run(master)
    mark = master.mark()
    assert master.refusal(1, 0x63FE, 0, bytes([VALID])) == WRONG_STATE
    master.rest(0.2)
    assert master.read(1, 0x63FE) == 0 and not master.since(mark, PLAIN[1])


def test_a_commissioned_node_sends_after_save_and_reset(master: Master) -> None:
    commission(master, 1)
    assert master.refusal(1, 0x1010, 1, b"save") == 0
    try:
        master.reset()
        assert [master.read(1, i) for i in (0x13FE, 0x63FE)] == [VALID, VALID]
        run(master)
        master.next(PLAIN[1], master.mark())
    finally:
        master.nmt(PRE_OPERATIONAL)
        assert master.refusal(1, 0x1011, 1, b"load") == 0
        master.reset()
    assert [master.read(1, i) for i in (0x13FE, 0x63FE)] == [0, 0]
    assert master.read(1, 0x13FF, 1) == 0x93A3, "a restore doesn't break the signature"
