"""EMCY, the error register and the list of errors (CiA 301, 7.2.7)."""

from __future__ import annotations

from typing import Iterator

import canopen
import pytest
from master import PRE_OPERATIONAL, RESET_NODE, START, STOP, Master, Plumb, until

TRIPPED, OVER = 0x5020, 0x0000
DEVICE = 0x21


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    """A housing at 30 deg: a measuring range below that is left as soon as it is set."""
    with Plumb("--speed", "4") as plumb:
        plumb.turn(30)
        yield plumb


def leave_range(master: Master, node: int = 1) -> None:
    master.write(node, 0x2040, 4, 20_000)


def enter_range(master: Master, node: int = 1) -> None:
    master.write(node, 0x2040, 4, 90_000)


def code(data: bytes) -> int:
    return int.from_bytes(data[:2], "little")


def emcy(master: Master, mark: int, wanted: int, node: int = 1) -> bytes:
    """The first EMCY with this code since the mark."""
    return bytes(master.next(0x80 + node, mark, data=lambda d: code(d) == wanted).data)


def test_an_error_is_sent_once_and_once_more_when_it_has_gone(master: Master) -> None:
    mark = master.mark()
    leave_range(master)
    data = emcy(master, mark, TRIPPED)
    assert len(data) == 8
    assert data[2] == DEVICE == master.read(1, 0x1001)
    assert int.from_bytes(data[3:6], "little") == 1 << 1, "fault 1: slope Y out of range"
    assert data[6:] == bytes(2), "nobody is blamed, and nothing was compared"
    master.rest(0.2)
    assert len(master.since(mark, 0x081)) == 1
    enter_range(master)
    data = emcy(master, mark, OVER)
    assert data[2] == 0 == master.read(1, 0x1001)
    assert data[3:] == bytes(5)


def test_python_canopen_gets_it_as_an_emergency(master: Master) -> None:
    node = master.nodes[1]
    node.emcy.reset()
    leave_range(master)
    until(lambda: node.emcy.active, "the emergency")
    assert node.emcy.active[0].code == TRIPPED
    enter_range(master)
    until(lambda: not node.emcy.active, "its end")


def test_1003h_keeps_the_newest_first(master: Master) -> None:
    leave_range(master)
    until(lambda: master.read(1, 0x1003) == 1, "an entry")
    assert master.read(1, 0x1003, 1) & 0xFFFF == TRIPPED
    mark = master.mark()
    master.sync(7)
    emcy(master, mark, 0x8240)
    assert [master.read(1, 0x1003, sub) & 0xFFFF for sub in (1, 2)] == [0x8240, TRIPPED]
    with pytest.raises(canopen.SdoAbortedError) as refused:
        master.read(1, 0x1003, 3)
    assert refused.value.code == 0x0800_0024, "no data"


def test_1003h_holds_eight_and_no_more(master: Master) -> None:
    for _ in range(10):
        mark = master.mark()
        leave_range(master)
        emcy(master, mark, TRIPPED)
        enter_range(master)
        emcy(master, mark, OVER)
    assert master.read(1, 0x1003) == 8
    assert {master.read(1, 0x1003, sub) & 0xFFFF for sub in range(1, 9)} == {TRIPPED}


def test_0_clears_1003h_and_nothing_else_may_be_written(master: Master) -> None:
    leave_range(master)
    until(lambda: master.read(1, 0x1003) == 1, "an entry")
    assert master.refusal(1, 0x1003, 0, b"\x01") == 0x0609_0030
    assert master.read(1, 0x1003) == 1
    assert master.refusal(1, 0x1003, 0, b"\x00") == 0
    assert master.read(1, 0x1003) == 0
    assert master.refusal(1, 0x1003, 1, bytes(4)) != 0
    assert master.read(1, 0x1001) == DEVICE, "the fault itself stands"


def test_1014h_moves_emcy_and_turns_it_off(master: Master) -> None:
    master.write(1, 0x1014, 0, 0x8000_0081)
    mark = master.mark()
    leave_range(master)
    until(lambda: master.read(1, 0x1001) == DEVICE, "the error")
    master.rest(0.1)
    assert not master.since(mark, 0x081)
    enter_range(master)
    until(lambda: master.read(1, 0x1001) == 0, "its end")
    master.write(1, 0x1014, 0, 0x0E1)
    leave_range(master)
    assert code(master.next(0x0E1, mark).data) == TRIPPED
    assert not master.since(mark, 0x081)


def test_1014h_is_refused_where_it_collides_and_while_emcy_is_on(master: Master) -> None:
    assert master.refusal(1, 0x1014, 0, (0x0E1).to_bytes(4, "little")) != 0, "it is on"
    master.write(1, 0x1014, 0, 0x8000_0081)
    for bad in (0x000, 0x101, 0x581, 0x601, 0x701, 0x2000_0081):
        assert master.refusal(1, 0x1014, 0, bad.to_bytes(4, "little")) == 0x0609_0030, f"{bad:X}"


def test_1015h_keeps_two_emcys_apart(master: Master) -> None:
    master.write(1, 0x1015, 0, 1000)
    mark = master.mark()
    leave_range(master)
    emcy(master, mark, TRIPPED)
    enter_range(master)
    emcy(master, mark, OVER)
    first, second = master.since(mark, 0x081)
    assert second.timestamp - first.timestamp >= 0.0995


def test_emcy_waits_while_the_node_is_stopped(plumb: Plumb, master: Master) -> None:
    master.nmt(STOP, 1)
    master.settle()
    mark = master.mark()
    plumb.type("fault a silent")
    master.rest(0.5)
    assert not master.since(mark, 0x081), "EMCY is no service of STOPPED"
    assert master.since(mark, 0x701)
    master.nmt(PRE_OPERATIONAL, 1)
    emcy(master, mark, 0xFF01)


@pytest.mark.parametrize(("behaviour", "state"), [(0, 127), (1, 5), (2, 4)])
def test_1029h_sets_what_an_error_of_the_instrument_does(
    plumb: Plumb, master: Master, behaviour: int, state: int
) -> None:
    master.write(2, 0x1029, 2, behaviour)
    master.write(2, 0x1017, 0, 50)
    master.nmt(START, 2)
    master.settle()
    mark = master.mark()
    plumb.type("fault b silent")
    try:
        if behaviour == 1:
            emcy(master, mark, 0xFF01, node=2)
        master.rest(0.4)
        assert bytes(master.since(mark, 0x702)[-1].data) == bytes([state])
    finally:
        plumb.type("heal b")
        master.nmt(RESET_NODE, 2)
        master.rest(0.5)


def test_1029h_as_delivered_changes_no_state(master: Master) -> None:
    assert [master.read(1, 0x1029, sub) for sub in (1, 2)] == [1, 1]


# The bit that stands for a code in bytes 3 to 5, by docs/canopen.md.
FAULTS = {
    code: bit
    for bit, code in enumerate(
        [0x5010, 0x5020, 0x3200, 0x4200, 0xFF01, 0xFF02, 0xFF03, 0xFF20, 0xFF21, 0xFF22]
        + [0xFF11, 0xFF12, 0xFF13, 0xFF14, 0xFF15, 0xFF16, 0xFF17]
        + [0xFF04, 0xFF05, 0xFF06, 0xFF07, 0xFF08]
    )
}


def balance(master: Master, mark: int, node: int) -> set[int]:
    """Checks that every fault was told once and taken back once; the codes told."""
    standing, codes = 0, set()
    for frame in master.since(mark, 0x80 + node):
        data = bytes(frame.data)
        faults = int.from_bytes(data[3:6], "little")
        if code(data) == OVER:
            assert standing & ~faults, "something has gone"
            standing &= faults
            assert standing == faults, "nothing stands that was never told"
            assert (data[2] == 0) == (faults == 0)
        else:
            bit = 1 << FAULTS[code(data)]
            assert faults & bit and not standing & bit, f"{code(data):X} told once"
            standing |= bit
            codes.add(code(data))
    assert standing == 0, "all was taken back"
    return codes


@pytest.mark.product("the paper's check names no channel")
@pytest.mark.parametrize(
    ("fault", "of_a", "of_b"),
    [
        ("brown-out", {0xFF15}, {0x3200, 0xFF14}),
        ("offset 20", {0xFF13, 0xFF15}, {0xFF13, 0xFF14, 0xFF08}),
        ("silent", {0xFF15}, {0xFF14}),
    ],
)
def test_every_emcy_is_taken_back_once(
    plumb: Plumb, master: Master, fault: str, of_a: set[int], of_b: set[int]
) -> None:
    for node in (1, 2):
        master.write(node, 0x2004, 0, 1)
        master.write(node, 0x2050, 1, 50)
    mark = master.mark()
    master.nmt(START)
    for node in (1, 2):
        until(lambda: master.read(node, 0x2021) == 1, f"agreement of node {node}", 10)
    plumb.type(f"fault b {fault}")
    try:
        for node, last in ((1, 0xFF15), (2, 0xFF14)):
            emcy(master, mark, last, node)
    finally:
        plumb.type("heal b")
    for node, codes in ((1, of_a), (2, of_b)):
        until(lambda: master.read(node, 0x2021) == 1, f"agreement of node {node} again", 10)
        until(lambda: master.read(node, 0x1001) == 0, f"no error of node {node}")
        assert codes <= balance(master, mark, node)


def test_a_lost_heartbeat_is_8130h_and_its_return_ends_it(plumb: Plumb, master: Master) -> None:
    master.rest(0.3)
    mark = master.mark()
    plumb.type("power b off")
    data = emcy(master, mark, 0x8130)
    assert data[2] & 0x10, "communication"
    plumb.type("power b on")
    emcy(master, mark, OVER)


def test_bus_off_ends_by_itself_and_is_8140h(plumb: Plumb, master: Master) -> None:
    mark = master.mark()
    plumb.type("bus noise 1", "+0.5 bus heal")
    for node in (1, 2):
        emcy(master, mark, 0x8140, node)
        emcy(master, mark, OVER, node)
        assert master.read(node, 0x2052, 6) == 1, "bus-offs"
        assert master.read(node, 0x2052, 1) == 0, "error active"


@pytest.mark.virtual("the wires of an emulated board break, and none of its frames alone")
def test_a_boot_up_message_that_bus_off_took_is_sent_again(plumb: Plumb, master: Master) -> None:
    plumb.type("fault b bus-off", "reset b")
    master.rest(1.5)
    mark = master.mark()
    plumb.type("heal b")
    master.next(0x702, mark)
    master.rest(0.5)
    told = [bytes(frame.data) for frame in master.since(mark, 0x702)]
    assert told[0] == b"\0" and told.count(b"\0") == 1
    # The master starts who has booted, and the pair is one again.
    until(lambda: master.read(2, 0x2020) & 3, "angles of node 2", 10)
    master.nmt(START)
    until(lambda: master.read(1, 0x2021) == 1, "agreement again", 10)


def test_error_passive_is_8120h(plumb: Plumb, master: Master) -> None:
    mark = master.mark()
    plumb.type("bus short 0.1")
    data = emcy(master, mark, 0x8120)
    assert data[2] & 0x10, "communication"
    emcy(master, mark, OVER)
