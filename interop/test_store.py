"""Storing and restoring parameters, over a restart of the whole instrument (CiA 301, 7.5.2.13)."""

from __future__ import annotations

import pathlib
from typing import Iterator

import pytest
from master import PRE_OPERATIONAL, RESET_COMMUNICATION, START, Master, Plumb, until

CANNOT_STORE, HARDWARE, WRONG_STATE = 0x0800_0020, 0x0606_0000, 0x0800_0022
ALL, COMMUNICATION, PROFILE, MANUFACTURER = 1, 2, 3, 4

# One parameter of each group: index, sub, type's bytes, a value of its own, the default.
PARAMETERS = {
    COMMUNICATION: (0x1017, 0, 2, 150, 200),
    PROFILE: (0x6000, 0, 2, 100, 10),
    MANUFACTURER: (0x2051, 0, 2, 1234, 1000),
}


@pytest.fixture(scope="module")
def plumb() -> Iterator[Plumb]:
    with Plumb() as plumb:
        yield plumb


@pytest.fixture
def master(plumb: Plumb) -> Iterator[Master]:
    """A master of two nodes that have forgotten all that was stored."""
    with Master(plumb) as master:
        master.nmt(PRE_OPERATIONAL)
        for node in (1, 2):
            assert load(master, node, ALL) == 0
        master.reset()
        yield master


def save(master: Master, node: int, sub: int, signature: bytes = b"save") -> int:
    return master.refusal(node, 0x1010, sub, signature)


def load(master: Master, node: int, sub: int, signature: bytes = b"load") -> int:
    return master.refusal(node, 0x1011, sub, signature)


def change(master: Master, node: int) -> None:
    """Writes a value of its own to one parameter of each group."""
    for index, sub, size, value, _ in PARAMETERS.values():
        assert master.refusal(node, index, sub, value.to_bytes(size, "little")) == 0


def changed(master: Master, node: int) -> set[int]:
    """The groups whose parameter has its own value; the others have their default."""
    found = set()
    for group, (index, sub, _, value, default) in PARAMETERS.items():
        held = master.read(node, index, sub)
        assert held in (value, default)
        if held == value:
            found.add(group)
    return found


def test_what_can_be_stored_and_how_is_read(master: Master) -> None:
    for index in (0x1010, 0x1011):
        assert master.read(1, index, 0) == 4
        assert [master.read(1, index, sub) for sub in (1, 2, 3, 4)] == [1, 1, 1, 1]


@pytest.mark.parametrize(
    "sub, groups",
    [
        (ALL, {COMMUNICATION, PROFILE, MANUFACTURER}),
        (COMMUNICATION, {COMMUNICATION}),
        (PROFILE, {PROFILE}),
        (MANUFACTURER, {MANUFACTURER}),
    ],
)
def test_each_group_outlasts_a_reset_where_it_was_saved_and_no_other(
    master: Master, sub: int, groups: set[int]
) -> None:
    change(master, 1)
    assert save(master, 1, sub) == 0
    master.reset(1)
    assert changed(master, 1) == groups
    assert changed(master, 2) == set()


def test_what_was_not_saved_is_gone_after_a_reset(master: Master) -> None:
    change(master, 1)
    master.reset(1)
    assert changed(master, 1) == set()


def test_a_reset_of_communication_takes_back_communication_alone(master: Master) -> None:
    change(master, 1)
    mark = master.mark()
    master.nmt(RESET_COMMUNICATION, 1)
    master.next(0x701, mark, data=lambda data: data == b"\0")
    assert changed(master, 1) == {PROFILE, MANUFACTURER}


@pytest.mark.parametrize("signature", [b"evas", b"SAVE", b"load", b"sav\0", bytes(4)])
def test_save_signature_byte_swapped_or_wrong_is_refused(
    master: Master, signature: bytes
) -> None:
    change(master, 1)
    assert save(master, 1, ALL, signature) == CANNOT_STORE
    master.reset(1)
    assert changed(master, 1) == set()


@pytest.mark.parametrize("signature", [b"daol", b"save", bytes(4)])
def test_restore_signature_byte_swapped_or_wrong_is_refused(
    master: Master, signature: bytes
) -> None:
    change(master, 1)
    assert save(master, 1, ALL) == 0
    assert load(master, 1, ALL, signature) == CANNOT_STORE
    master.reset(1)
    assert changed(master, 1) == {COMMUNICATION, PROFILE, MANUFACTURER}


def test_a_restore_counts_from_the_next_reset(master: Master) -> None:
    change(master, 1)
    assert save(master, 1, ALL) == 0
    assert load(master, 1, ALL) == 0
    assert changed(master, 1) == {COMMUNICATION, PROFILE, MANUFACTURER}
    master.reset(1)
    assert changed(master, 1) == set()


def test_a_group_is_restored_by_itself(master: Master) -> None:
    change(master, 1)
    assert save(master, 1, ALL) == 0
    assert load(master, 1, PROFILE) == 0
    master.reset(1)
    assert changed(master, 1) == {COMMUNICATION, MANUFACTURER}


def test_nothing_is_stored_or_restored_in_operational(master: Master) -> None:
    master.nmt(START, 1)
    until(lambda: save(master, 1, ALL) == WRONG_STATE, "refusal in OPERATIONAL")
    assert load(master, 1, ALL) == WRONG_STATE


@pytest.mark.virtual("an emulated flash does not wear out by a word")
def test_a_memory_that_fails_reports_it_and_keeps_what_it_had(
    plumb: Plumb, master: Master
) -> None:
    change(master, 1)
    assert save(master, 1, ALL) == 0
    master.write(1, 0x1017, 0, 50)
    mark = master.mark()
    plumb.type("fault a memory")
    plumb.truth()
    assert save(master, 1, ALL) == HARDWARE
    assert bytes(master.next(0x81, mark).data)[:2] == b"\x22\xff"
    plumb.type("heal a")
    master.reset(1)
    assert changed(master, 1) == {COMMUNICATION, PROFILE, MANUFACTURER}


def test_a_preset_is_stored_with_the_profile(master: Master) -> None:
    """Zero set on the machine is zero after the next start."""
    master.write(1, 0x6112, 0, 500)
    assert abs(master.read(1, 0x6110) - 500) < 10
    offset = master.read(1, 0x6113)
    assert save(master, 1, PROFILE) == 0
    master.reset(1)
    assert master.read(1, 0x6113) == offset
    assert abs(master.read(1, 0x6110) - 500) < 10


def test_a_pdo_set_up_anew_is_stored_with_communication(master: Master) -> None:
    identifier = master.read(1, 0x1800, 1)
    master.write(1, 0x1800, 1, 0x8000_0000 | identifier)
    master.write(1, 0x1A00, 0, 0)
    master.write(1, 0x1A00, 1, 0x6110_0020)
    master.write(1, 0x1A00, 0, 1)
    master.write(1, 0x1800, 1, identifier)
    assert save(master, 1, COMMUNICATION) == 0
    master.reset(1)
    assert [master.read(1, 0x1A00, sub) for sub in (0, 1)] == [1, 0x6110_0020]
    master.nmt(START, 1)
    mark = master.mark()
    master.sync()
    assert len(master.next(0x181, mark).data) == 4


def test_a_stored_restore_doesn_t_break_a_stored_safety_signature(master: Master) -> None:
    """Restoring leaves signature and parameters of the safety frames in step."""
    signature = master.read(1, 0x13FF, 1)
    assert save(master, 1, ALL) == 0
    assert load(master, 1, COMMUNICATION) == 0
    master.reset(1)
    assert master.read(1, 0x13FF, 1) == signature
    assert master.refusal(1, 0x13FF, 1, signature.to_bytes(2, "little")) == 0
    assert master.refusal(1, 0x13FE, 0, b"\xa5") == 0


def test_the_date_of_the_configuration_is_kept_until_something_changes(master: Master) -> None:
    """1020h tells a tool whether it can leave the configuration alone."""
    for sub, value in ((1, 15_300), (2, 43_200_000)):
        master.write(1, 0x1020, sub, value)
    assert save(master, 1, COMMUNICATION) == 0
    master.reset(1)
    assert [master.read(1, 0x1020, sub) for sub in (1, 2)] == [15_300, 43_200_000]
    master.write(1, 0x1017, 0, 100)
    assert [master.read(1, 0x1020, sub) for sub in (1, 2)] == [0, 0]


def test_a_refused_write_leaves_the_date_of_the_configuration(master: Master) -> None:
    master.write(1, 0x1020, 1, 15_300)
    assert master.refusal(1, 0x1017, 0, bytes(4)) != 0
    assert master.read(1, 0x1020, 1) == 15_300


@pytest.mark.virtual("an emulated flash is not kept in files")
def test_stored_parameters_are_there_after_a_restart_of_the_instrument(
    tmp_path: pathlib.Path,
) -> None:
    state = str(tmp_path)
    with Plumb("--state", state) as plumb, Master(plumb) as master:
        change(master, 1)
        assert save(master, 1, ALL) == 0
        change(master, 2)
    with Plumb("--state", state) as plumb, Master(plumb) as master:
        assert changed(master, 1) == {COMMUNICATION, PROFILE, MANUFACTURER}
        assert changed(master, 2) == set()
        assert load(master, 1, ALL) == 0
    with Plumb("--state", state) as plumb, Master(plumb) as master:
        assert changed(master, 1) == set()
