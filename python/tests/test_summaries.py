"""Summaries of logs: the report of one is that of its log, and merging is exact."""

from __future__ import annotations

import itertools
import json
import os
import pathlib
import random
import re
import signal

import pytest
from conftest import candump, interrupted, run, sentence, shift

import plumb

DAY_S = 86_400.0

FAULTS = ["", "+1 s fault b stuck", "+1 s fault a bias x 20 mg", "+1 s power b off"]


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[pathlib.Path]:
    """Days of one machine, of which two have no fault, on two interfaces."""
    folder = tmp_path_factory.mktemp("days")
    found = []
    for number, words in enumerate([*FAULTS, *FAULTS[:1]]):
        path = folder / f"day{number}.log"
        text = candump(shift(10 + number, 3.0, words), 1_790_000_000.0 + number * DAY_S)
        path.write_text(text.replace("can0", "can1") if number == 4 else text)
        found.append(path)
    return found


@pytest.fixture(scope="module")
def summaries(logs: list[pathlib.Path]) -> list[bytes]:
    return [plumb.summarise(log) for log in logs]


def data(folder: pathlib.Path) -> dict[str, object]:
    """The report without what it has of the files."""
    report = json.loads((folder / "report.json").read_text())
    report.pop("logs")
    return report


@pytest.mark.parametrize("number", range(5))
def test_the_report_of_a_summary_is_that_of_its_log(
    number: int,
    program: pathlib.Path,
    logs: list[pathlib.Path],
    summaries: list[bytes],
    tmp_path: pathlib.Path,
) -> None:
    page = plumb.report(summaries[number], tmp_path / "own", bit_rate=250_000)
    done = run(program, "report", logs[number], "--out", tmp_path / "wanted", "-b", 250_000)
    assert done.returncode == 0, done.stderr
    assert page == tmp_path / "own" / "report.html" and "<html" in page.read_text()
    assert data(tmp_path / "own") == data(tmp_path / "wanted")


def test_merging_in_any_order_and_grouping_gives_the_same_bytes(summaries: list[bytes]) -> None:
    wanted = plumb.merge(summaries)
    assert wanted not in summaries
    for order in itertools.permutations(summaries):
        assert plumb.merge(order) == wanted
    draw = random.Random(18)
    for _ in range(40):
        heap = list(summaries)
        draw.shuffle(heap)
        while len(heap) > 1:
            count = draw.randint(2, len(heap))
            group, heap = heap[:count], heap[count:]
            heap.insert(draw.randint(0, len(heap)), plumb.merge(group))
        assert heap == [wanted]


def test_more_events_than_there_is_room_for_merge_to_the_same(
    tmp_path: pathlib.Path,
) -> None:
    parts = []
    for number in range(6):
        lines = []
        for event in range(60):
            at_s = 1_790_000_000 + 3000 * event + 500 * number
            lines.append(f"({at_s}.000000) can0 181#E80301003D01\n")
            lines.append(f"({at_s}.100000) can0 081#01FF81100000000F\n")
            lines.append(f"({at_s}.200000) can0 080#\n({at_s}.300000) can0 081#0000000000000000\n")
        path = tmp_path / f"part{number}.log"
        path.write_text("".join(lines))
        parts.append(plumb.summarise(path))
    wanted = plumb.merge(parts)
    report = plumb.report(wanted, tmp_path / "out")
    [instrument] = json.loads(report.with_suffix(".json").read_text())["instruments"]
    assert len(instrument["events"]) == 200 and instrument["faults_left_out"] == 160
    times = [event["time_s"] for event in instrument["events"]]
    assert times == sorted(times)
    for split in range(1, 6):
        groups = [plumb.merge(parts[split:]), plumb.merge(parts[:split][::-1])]
        assert plumb.merge(groups) == wanted


def test_one_summary_merges_to_itself_and_is_the_same_wherever_the_log_is(
    logs: list[pathlib.Path], summaries: list[bytes], tmp_path: pathlib.Path
) -> None:
    assert [plumb.merge([one]) for one in summaries] == summaries
    moved = tmp_path / logs[0].name
    moved.write_bytes(logs[0].read_bytes())
    assert plumb.summarise(moved) == summaries[0]


def test_the_size_does_not_grow_with_the_log(tmp_path: pathlib.Path) -> None:
    text = candump(shift(6, 2.0))
    sizes = []
    for times in (1, 40):
        path = tmp_path / "log.log"
        path.write_text(text * times)
        sizes.append(len(plumb.summarise(path)))
    assert sizes[1] < 1.3 * sizes[0], sizes


def test_what_can_not_be_read_is_told_and_the_rest_counted(
    program: pathlib.Path, log: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    with pytest.warns(plumb.IncompleteWarning) as told:
        summary = plumb.summarise(log)
    assert [str(warning.message) for warning in told] == [
        sentence(program, "report", log, "--out", tmp_path)
    ]
    assert json.loads(summary)["logs"]["skipped"][0]["count"] == 1


@pytest.mark.parametrize(
    ("summary", "words"),
    [
        (b"", "these bytes are no summary of logs"),
        (b"PK\x03\x04", "these bytes are no summary of logs"),
        (b'{"format": "plumb-period", "version": 1}', "their format is not plumb-summary"),
        (
            b'{"format": "plumb-summary", "version": 7, "more": []}',
            "this summary is of version 7, and version 2 is read: summarise its log anew",
        ),
    ],
)
def test_bytes_that_are_no_summary_are_told_in_a_sentence(
    summary: bytes, words: str, summaries: list[bytes], tmp_path: pathlib.Path
) -> None:
    for what in (
        lambda: plumb.merge([summaries[0], summary]),
        lambda: plumb.report(summary, tmp_path / "out"),
    ):
        with pytest.raises(plumb.Error) as told:
            what()
        assert words in str(told.value) and "\n" not in str(told.value)
    assert not (tmp_path / "out").exists()


def test_a_cut_summary_is_told(summaries: list[bytes]) -> None:
    with pytest.raises(plumb.Error, match="these bytes are no summary"):
        plumb.merge([summaries[0][:-10]])


def test_nothing_to_merge_or_to_summarise_is_told(
    program: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    with pytest.raises(plumb.Error, match="there is no summary to merge"):
        plumb.merge([])
    for what in (plumb.summarise, plumb.decode):
        with pytest.raises(plumb.Error, match="there is no log: give at least one"):
            what([])
    with pytest.raises(plumb.Error, match="merge takes a list of summaries"):
        plumb.merge(b"one alone")
    with pytest.raises(plumb.Error) as told:
        plumb.summarise(tmp_path)
    assert str(told.value) == sentence(program, "report", tmp_path, "--out", tmp_path / "out")


def test_a_report_that_can_not_be_written_names_no_option(
    summaries: list[bytes], tmp_path: pathlib.Path
) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(plumb.Error) as told:
        plumb.report(summaries[0], tmp_path / "file" / "out")
    assert str(told.value).endswith("; choose another one") and "--" not in str(told.value)


def test_a_sentence_has_the_names_of_arguments_in_place_of_options(log: pathlib.Path) -> None:
    with pytest.raises(plumb.Error, match="^end is not after begin: swap them$"):
        plumb.decode(log, begin="5", end="2").read_all()
    with pytest.raises(plumb.Error, match="^nodes needs two node-ids for each instrument"):
        plumb.summarise(log, nodes=[1])


@pytest.mark.parametrize("bit_rate", [0, -1, float("nan"), float("inf")])
def test_a_bit_rate_that_is_none_is_refused(
    bit_rate: float, summaries: list[bytes], tmp_path: pathlib.Path
) -> None:
    with pytest.raises(plumb.Error, match="bit/s is no bit rate: give more than 0"):
        plumb.report(summaries[0], tmp_path / "out", bit_rate=bit_rate)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("node", [-1, 0, 128, 300])
def test_a_number_that_is_no_node_id_is_told_in_a_sentence(node: int, log: pathlib.Path) -> None:
    for count in (plumb.decode, plumb.summarise):
        with pytest.raises(plumb.Error, match=f"^{node} is no node-id: give 1 to 127$"):
            count(log, nodes=[1, node])


@pytest.mark.parametrize("name", ["frames", "overlapping", "count", "covered_ns", "syncs", "sum"])
def test_merging_counters_near_the_greatest_number_was_a_panic(
    name: str, summaries: list[bytes], tmp_path: pathlib.Path
) -> None:
    greatest = (1 << 127 if name == "sum" else 1 << 64) - 1
    forged = re.sub(rb'"%s":-?\d+' % name.encode(), b'"%s":%d' % (name.encode(), greatest), summaries[0])
    assert forged != summaries[0]
    merged = plumb.merge([forged, forged, summaries[1]])
    assert plumb.merge([summaries[1], plumb.merge([forged, forged])]) == merged
    plumb.report(merged, tmp_path / "report")


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (rb'"level":\d+', b"bins are wider or more than they can be"),
        (rb'"step_mdeg":\d+', b"a histogram has a step that there is not"),
    ],
)
def test_a_summary_with_numbers_that_there_are_not_is_told_in_a_sentence(
    text: bytes, wanted: bytes, summaries: list[bytes]
) -> None:
    forged = re.sub(text, text.partition(b":")[0] + b":99", summaries[0])
    with pytest.raises(plumb.Error, match=wanted.decode()):
        plumb.merge([forged, summaries[1]])


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="there is no such signal")
def test_ctrl_c_waited_for_the_end_of_a_merge(summaries: list[bytes]) -> None:
    with interrupted(0.2):
        plumb.merge(summaries * 2000)


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="there is no such signal")
def test_ctrl_c_waited_for_the_end_of_a_log(tmp_path: pathlib.Path) -> None:
    # A log without an end, as long as the test holds the pipe open.
    pipe = tmp_path / "endless.log"
    os.mkfifo(pipe)
    end = os.open(pipe, os.O_RDWR)
    try:
        os.write(end, candump(shift(6, 0.5)).encode())
        with interrupted(0.2):
            plumb.summarise(pipe)
    finally:
        os.close(end)


OTHERS = ("restart", "memory")
"""Kinds of events that each start of these logs has: a first boot-up is no restart."""


@pytest.mark.parametrize("words", ["fault b stuck", "power b off", "fault a silent"])
def test_a_fault_that_stood_in_the_morning_stood_for_ever_in_what_was_merged(
    words: str, tmp_path: pathlib.Path
) -> None:
    both = [tmp_path / "morning.log", tmp_path / "noon.log"]
    for number, (path, own) in enumerate(zip(both, [f"+1 s {words}", ""])):
        path.write_text(candump(shift(7, 3.0, own), 1_790_000_000.0 + 3600.0 * number))

    def ends(summary: bytes) -> list[tuple]:
        plumb.report(summary, tmp_path / "report")
        [instrument] = json.loads((tmp_path / "report/report.json").read_text())["instruments"]
        events = [event for event in instrument["events"] if event["kind"] not in OTHERS]
        return sorted((event["text"], event["end"], event["duration_s"]) for event in events)

    apart = plumb.merge(map(plumb.summarise, reversed(both)))
    assert ends(apart) == ends(plumb.summarise(both))
    assert not any(end == "standing" for _, end, _ in ends(apart))
    plumb.report(plumb.summarise(both[0]), tmp_path / "report")
    assert '"standing"' in (tmp_path / "report/report.json").read_text()
