"""The electronic data sheets load, and the device keeps what they promise (CiA 306)."""

from __future__ import annotations

import pathlib
import re
from typing import Callable, Iterator, NamedTuple

import canopen
import pytest
from canopen.objectdictionary import ODVariable, datatypes, eds
from master import EMULATED, MODE, OWN_SHEETS, ROOT, Master, Plumb, until

NO_DATA = 0x0800_0024
PAPER = OWN_SHEETS == "plumb-paper"
DYNAMIC = OWN_SHEETS == "plumb-dynamic"
# The virtual instrument in the paper's mode lets a tool choose (docs/canopen.md).
BOTH_RULES = MODE == "paper" and not EMULATED
CHANNELS = {1: "a", 2: "b"}

# What has nothing to read on a fresh node: an error that never was, a residual without a point,
# samples around an event.
EMPTY = {(0x1003, sub) for sub in range(1, 9)}
EMPTY |= {(0x2060, 6), (0x2063, 0), (0x2071, 1), (0x2071, 2)}


class Row(NamedTuple):
    """An object as docs/objects.md has it."""

    type: str
    access: str
    map: str
    default: dict[int, str]


def rows() -> dict[tuple[int, int], Row]:
    """Every object of docs/objects.md, or of the paper's page."""
    table = {}
    for line in (ROOT / "docs" / OWN_SHEETS.replace("plumb", "objects")).with_suffix(".md").read_text().splitlines():
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        if len(cells) != 12 or not re.fullmatch("[0-9A-F]{4}", cells[0]):
            continue
        first, _, last = cells[1].partition(" to ")
        for sub in range(int(first, 16), int(last or first, 16) + 1):
            default = {1: cells[9], 2: cells[10]}
            table[int(cells[0], 16), sub] = Row(cells[3], cells[4], cells[5], default)
    return table


def variables(dictionary: canopen.ObjectDictionary) -> dict[tuple[int, int], ODVariable]:
    """Every object of a data sheet, without the dummies for gaps in a PDO."""
    found = {}
    for index, entry in dictionary.items():
        if index < 0x1000:
            continue
        parts = [entry] if isinstance(entry, ODVariable) else entry.values()
        found.update({(index, part.subindex): part for part in parts})
    return found


def number(text: str, node: int) -> int:
    """A default of the table, such as 0x180 + id."""
    return sum(node if part == "id" else int(part, 0) for part in text.split(" + "))


@pytest.fixture(scope="module")
def fresh() -> Iterator[Master]:
    """Both nodes as delivered, with valid angles; nothing is written to them."""
    with Plumb() as plumb, Master(plumb, sheets=OWN_SHEETS) as master:
        for id in master.nodes:
            until(lambda: master.read(id, 0x2020) & 0x03, f"angles of node {id}", 10)
        yield master


@pytest.fixture(scope="module", params=CHANNELS)
def node(request: pytest.FixtureRequest) -> int:
    return request.param


@pytest.fixture(scope="module")
def sheet(fresh: Master, node: int) -> dict[tuple[int, int], ODVariable]:
    return variables(fresh.nodes[node].object_dictionary)


def test_sheet_and_table_have_the_same_objects(
    sheet: dict[tuple[int, int], ODVariable],
) -> None:
    assert len(sheet) > (220 if PAPER else 300)
    assert sheet.keys() == rows().keys()


def test_every_type_is_the_table_s(sheet: dict[tuple[int, int], ODVariable]) -> None:
    for at, row in rows().items():
        assert sheet[at].data_type == getattr(datatypes, row.type), at


def test_every_access_is_the_table_s(sheet: dict[tuple[int, int], ODVariable]) -> None:
    for at, row in rows().items():
        assert sheet[at].access_type == row.access, at


def test_what_a_pdo_can_carry_is_the_table_s(
    sheet: dict[tuple[int, int], ODVariable],
) -> None:
    for at, row in rows().items():
        assert sheet[at].pdo_mappable == bool(set(row.map) & {"T", "R"}), at
        # A PLC's tool maps by the access type: what a TPDO carries can be read, what an RPDO
        # carries can be written.
        assert "T" not in row.map or row.access in ("ro", "rwr", "const"), at
        assert "R" not in row.map or row.access in ("wo", "rww"), at


def test_every_default_is_the_table_s(
    node: int, sheet: dict[tuple[int, int], ODVariable]
) -> None:
    compared = 0
    for at, row in rows().items():
        if row.type == "VISIBLE_STRING":
            assert sheet[at].default == row.default[node], at
        elif row.default[node]:
            assert sheet[at].default == number(row.default[node], node), at
            compared += 1
    assert compared > (130 if PAPER else 200)


def test_everything_readable_is_read_with_the_length_of_its_type(
    fresh: Master, node: int, sheet: dict[tuple[int, int], ODVariable]
) -> None:
    for at, variable in sheet.items():
        if at in EMPTY or not variable.readable:
            continue
        data = fresh.nodes[node].sdo.upload(*at)
        if variable.data_type in datatypes.NUMBER_TYPES:
            assert 8 * len(data) == len(variable), f"{at[0]:X}h sub {at[1]}"
        else:
            assert data, f"{at[0]:X}h sub {at[1]}"


def test_what_is_empty_or_write_only_is_aborted_with_its_code(
    fresh: Master, node: int, sheet: dict[tuple[int, int], ODVariable]
) -> None:
    for at, variable in sheet.items():
        if at not in EMPTY and variable.readable:
            continue
        with pytest.raises(canopen.SdoAbortedError) as abort:
            fresh.nodes[node].sdo.upload(*at)
        assert abort.value.code == (NO_DATA if at in EMPTY else 0x0601_0001), at


def test_every_default_is_what_a_fresh_node_holds(
    fresh: Master, node: int, sheet: dict[tuple[int, int], ODVariable]
) -> None:
    for at, variable in sheet.items():
        if variable.default is None:
            continue
        held = variable.decode_raw(fresh.nodes[node].sdo.upload(*at))
        assert held == variable.default, f"{at[0]:X}h sub {at[1]}"


def part(at: tuple[int, int]) -> str:
    """What an object is to a tool that goes by CiA 301 when it maps."""
    index, sub = at
    if 0x1400 <= index < 0x1600 or 0x1800 <= index < 0x1A00:
        return "cob-id" if sub == 1 else "other"
    maps = 0x1381 <= index < 0x13FE or 0x1600 <= index < 0x1800 or 0x1A00 <= index < 0x1C00
    if maps and sub == 0:
        return "count"
    return "signature" if index in (0x13FE, 0x13FF, 0x63FE, 0x63FF) else "other"


def ascending(delivered: list[tuple[tuple[int, int], bytes]]) -> list[tuple[tuple[int, int], bytes]]:
    """As a tool writes that goes through the sheet."""
    return delivered


def by_the_book(
    delivered: list[tuple[tuple[int, int], bytes]],
) -> list[tuple[tuple[int, int], bytes]]:
    """PDOs off, nothing mapped, the entries, how many, PDOs on; signatures come last."""
    of = {kind: [d for d in delivered if part(d[0]) == kind] for kind in
          ("cob-id", "count", "other", "signature")}
    off = [(at, bytes([*data[:3], data[3] | 0x80])) for at, data in of["cob-id"]]
    none = [(at, b"\0") for at, _ in of["count"]]
    return off + none + of["other"] + of["count"] + of["cob-id"] + of["signature"]


@pytest.mark.parametrize("order", [ascending, by_the_book])
def test_every_default_can_be_written_back(order: Callable) -> None:
    """A tool that downloads the whole sheet must not be stopped by what was delivered."""
    with Plumb() as plumb, Master(plumb, sheets=OWN_SHEETS) as master:
        for node in CHANNELS:
            objects = variables(master.nodes[node].object_dictionary)
            writable = {at: v for at, v in sorted(objects.items()) if v.writable}
            delivered = [
                (at, v.encode_raw(v.default)) for at, v in writable.items() if v.default is not None
            ]
            assert len(delivered) > (100 if PAPER else 200)
            for at, data in order(delivered):
                code = master.refusal(node, *at, data)
                assert code == 0, f"{at[0]:X}h sub {at[1]} of node {node}: {code:08X}"
            for at, data in delivered:
                assert master.nodes[node].sdo.upload(*at) == data, f"{at[0]:X}h sub {at[1]}"


@pytest.mark.sheets("no safety, and no presets")
def test_what_acts_when_it_is_written_has_no_default(
    sheet: dict[tuple[int, int], ODVariable],
) -> None:
    """Written back it would store, set a slope to zero, or be refused."""
    acting = {(index, sub) for index in (0x1010, 0x1011) for sub in range(1, 5)}
    acting |= {(index, 0) for index in (0x6012, 0x6022, 0x6112, 0x6122, 0x6812, 0x6922, 0x2072)}
    for at in acting | {(0x1F51, 1)}:
        assert sheet[at].writable and sheet[at].default is None, at


def test_a_number_without_a_default_has_an_empty_key(node: int) -> None:
    """Where it is missing a widespread master has no size for the number, and fails. Of numbers of
    24 bit it refuses any value, and of a DOMAIN an empty value is a content."""
    for ending in ("eds", "dcf"):
        text = (ROOT / "eds" / f"{OWN_SHEETS}-{CHANNELS[node]}.{ending}").read_text()
        empty = 0
        for section in re.split(r"^\[", text, flags=re.M):
            keys = dict(re.findall(r"^(\w+)=(.*)$", section, re.M))
            if "DataType" not in keys:
                continue
            without = int(keys["DataType"], 16) in (0x0F, 0x10, 0x16)
            assert ("DefaultValue" not in keys) == without, section
            empty += keys.get("DefaultValue") == ""
        assert empty > 50


def test_everything_read_only_refuses_a_write(
    fresh: Master, node: int, sheet: dict[tuple[int, int], ODVariable]
) -> None:
    for at, variable in sheet.items():
        if variable.writable or at == (0x2003, 0) and BOTH_RULES:
            continue
        size = len(variable) // 8 if variable.data_type in datatypes.NUMBER_TYPES else 4
        code = fresh.refusal(node, *at, bytes(size))
        assert code == 0x0601_0002, f"{at[0]:X}h sub {at[1]}: {code:08X}"


def test_the_device_information_is_the_device_s(fresh: Master, node: int) -> None:
    about = fresh.nodes[node].object_dictionary.device_information
    assert about.vendor_number == fresh.read(node, 0x1018, 1)
    assert about.product_number == fresh.read(node, 0x1018, 2)
    assert about.revision_number == fresh.read(node, 0x1018, 3)
    assert about.LSS_supported != PAPER
    tpdos = 7 if DYNAMIC else 4
    assert (about.nr_of_TXPDO, about.nr_of_RXPDO) == (tpdos, 2 if PAPER else 4)
    assert about.allowed_baudrates == {k * 1000 for k in (10, 20, 50, 125, 250, 500, 800, 1000)}


def test_the_configuration_files_name_node_and_bit_rate(node: int) -> None:
    path = ROOT / "eds" / f"{OWN_SHEETS}-{CHANNELS[node]}.dcf"
    dictionary = eds.import_eds(str(path), None)
    assert (dictionary.node_id, dictionary.bitrate) == (node, 250_000)
    loaded, sheet = variables(dictionary), variables(
        canopen.import_od(str(path.with_suffix(".eds")), node)
    )
    assert loaded.keys() == sheet.keys()


@pytest.mark.sheets("no safety, and no presets")
def test_safety_keys_are_in_the_sheet(node: int) -> None:
    """python-canopen doesn't read them; a safety tool does (EN 50325-5)."""
    text = pathlib.Path(ROOT / "eds" / f"{OWN_SHEETS}-{CHANNELS[node]}.eds").read_text()
    assert re.search("^CANopenSafetySupported=1$", text, re.M)
    slope = text.partition("[6210]")[2].partition("[")[0]
    assert "SRDOMapping=1" in slope and "InvertedSRAD=0x621100" in slope


def test_pdos_decode_by_the_sheet(fresh: Master, node: int) -> None:
    """What a tool does: read the mapping from the node, then take values by name."""
    remote = fresh.nodes[node]
    remote.tpdo.read()
    names = [variable.name for variable in remote.tpdo[1]]
    assert names == ["Slope long16", "Slope lateral16", "Validity", "State of the pair"]
    assert [len(remote.tpdo[n]) for n in (2, 3, 4)] == [6, 4, 5]
    if DYNAMIC:
        assert [len(remote.tpdo[n]) for n in (5, 6, 7)] == [5, 4, 5]
