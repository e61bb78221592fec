"""The questions to the figures of a fleet: against numbers that are known, and against a synthetic
fleet whose faults are known."""

from __future__ import annotations

import datetime
import pathlib
import random
import re
import subprocess
import sys

import pyarrow
import pyarrow.parquet
import pytest
from conftest import ROOT
from fleets import put, text

import plumb
from plumb.fleet import QUESTIONS, FleetError, Rules, query, run, synthetic, visits
from plumb.fleet.figures import COLUMNS, SCHEMA
from plumb.fleet.store import MACHINES, write_table
from plumb.fleet.synthetic import Machine, upload
from plumb.fleet.visits import URGENCY

FIRST = datetime.date(2026, 9, 1)


def day(number: int) -> str:
    return (FIRST + datetime.timedelta(number)).isoformat()


def row(machine: str, number: int, **values: object) -> dict[str, object]:
    """A machine's day without anything wrong; A - B has an uncertainty of 0.05 deg (k = 1)."""
    empty = dict.fromkeys(COLUMNS)
    counts = {name: 0 for name in COLUMNS if name.endswith("_count")}
    known = {"a_uncertainty_deg_mean": 0.03, "b_uncertainty_deg_mean": 0.04, "covered_s": 3600.0}
    head = {"machine": machine, "day": day(number), "interface": "can0", "instrument": 1}
    return empty | counts | known | head | {"standing": 0, "incidents": 0} | values


def folder(out: pathlib.Path, rows: list[dict], machines: list[dict] | None = None) -> pathlib.Path:
    """A folder with these figures."""
    for number in sorted({row["day"] for row in rows}):
        own = [row for row in rows if row["day"] == number]
        write_table(out / "figures" / number / "rows.parquet", own, SCHEMA)
    write_table(out / "machines.parquet", machines or [], MACHINES)
    return out


def reasons(out: pathlib.Path, **rules: object) -> dict[str, list[str]]:
    found = visits(out, Rules(**rules))
    return {visit.machine: [reason.kind for reason in visit.reasons] for visit in found}


@pytest.mark.parametrize("question", QUESTIONS)
def test_every_question_has_an_answer(question: str, tmp_path: pathlib.Path) -> None:
    out = folder(tmp_path, [row("m", 0, warning_count=1, a_software="1")])
    query(out, question, today=day(0))


def test_faults_per_hour_are_those_of_machine_model_and_firmware(tmp_path: pathlib.Path) -> None:
    rows = [
        row("a", 0, fault_count=6, incidents=3, a_software="1.0"),
        row("a", 1, fault_count=0, a_software="2.0"),
        row("b", 1, warning_count=4, incidents=1, a_product_code=0x2A, a_software="2.0"),
        row("c", 1, a_revision=0x10000),
    ]
    out = folder(tmp_path, rows, [{"machine": "a", "model": "crane"}])
    found = {
        (one["grouped_by"], one["name"]): (one["hours"], one["faults"], one["incidents_per_hour"])
        for one in query(out, "faults").to_pylist()
    }
    assert found == {
        ("machine", "a"): (2.0, 6, 1.5),
        ("machine", "b"): (1.0, 0, 1.0),
        ("machine", "c"): (1.0, 0, 0.0),
        ("model", "crane"): (2.0, 6, 1.5),
        ("model", "product 0000002Ah"): (1.0, 0, 1.0),
        ("model", "unknown"): (1.0, 0, 0.0),
        ("firmware", "1.0"): (1.0, 6, 3.0),
        ("firmware", "2.0"): (2.0, 0, 0.5),
        ("firmware", "revision 00010000h"): (1.0, 0, 0.0),
    }


def test_a_drift_has_the_slope_the_error_and_the_date_of_the_book(tmp_path: pathlib.Path) -> None:
    draw = random.Random(3)
    means = [0.001 * number + draw.gauss(0, 0.004) for number in range(40)]
    rows = [
        row("m", number, difference_x_count=10, difference_x_mean=mean)
        for number, mean in enumerate(means)
    ]
    [found] = query(folder(tmp_path, rows), "drift").to_pylist()
    middle, mean = sum(range(40)) / 40, sum(means) / 40
    sxx = sum((number - middle) ** 2 for number in range(40))
    slope = sum((n - middle) * (y - mean) for n, y in enumerate(means)) / sxx
    rest = sum((y - mean - slope * (n - middle)) ** 2 for n, y in enumerate(means))
    error = (rest / 38 / sxx) ** 0.5
    level = mean + slope * (39 - middle)
    assert found["deg_per_day"] == pytest.approx(slope, rel=1e-9)
    assert found["deg_per_day_error"] == pytest.approx(error, rel=1e-6)
    assert found["band_deg"] == pytest.approx(0.1) and not found["outside"]

    def leaves(slope: float) -> datetime.date:
        days = -((level - 0.1) / slope) // 1
        return FIRST + datetime.timedelta(39 + int(days) + 1)

    assert found["leaves_on"] == leaves(slope)
    assert found["leaves_earliest"] == leaves(slope + 2 * error)
    assert found["leaves_latest"] == leaves(slope - 2 * error)


@pytest.mark.parametrize(
    ("per_day", "level", "is_found"),
    [(0.0, 0.05, False), (0.0, 0.12, True), (0.003, 0.05, True), (-0.003, -0.05, True),
     (0.0005, 0.02, False), (-0.003, 0.09, False)],
)
def test_a_drift_needs_a_visit_where_it_leaves_the_band_soon(
    per_day: float, level: float, is_found: bool, tmp_path: pathlib.Path
) -> None:
    draw = random.Random(1)
    rows = [
        row("m", number, difference_y_count=9,
            difference_y_mean=level + per_day * (number - 19) + draw.gauss(0, 0.003))
        for number in range(20)
    ]
    assert reasons(folder(tmp_path, rows)) == ({"m": ["drift"]} if is_found else {})


def test_a_noisy_difference_is_no_drift(tmp_path: pathlib.Path) -> None:
    draw = random.Random(9)
    rows = [
        row(f"m{machine:03}", number, difference_x_count=9, difference_x_mean=draw.gauss(0, 0.03))
        for machine in range(150)
        for number in range(12)
    ]
    assert len(reasons(folder(tmp_path, rows))) <= 1


def test_histories_have_temperature_and_vibration_day_by_day(tmp_path: pathlib.Path) -> None:
    values = {f"{side}_temperature_degc_{name}": value for side, shift in (("a", 0), ("b", 2))
              for name, value in (("min", 10 + shift), ("mean", 20 + shift), ("max", 30 + shift))}
    shaken = {"a_activity_mean": 72.0, "b_activity_mean": 72.0, "a_activity_max": 80.0,
              "b_activity_max": 88.0}
    found = query(folder(tmp_path, [row("m", 0, **values, **shaken)]), "histories").to_pylist()
    assert [(one["temperature_min_degc"], one["temperature_mean_degc"],
             one["temperature_max_degc"], one["vibration_middle"], one["vibration_max"])
            for one in found] == [(10.0, 21.0, 32.0, 2.0, 8.0)]


@pytest.mark.parametrize(
    ("figures", "manifest", "kinds"),
    [
        ({}, {"calibration_due": day(0)}, ["overdue"]),
        ({}, {"calibration_due": day(1)}, []),
        ({"a_calibration_crc32": "AB", "b_calibration_crc32": "CD"},
         {"certificate_crc32": "ab, cd"}, []),
        ({"a_calibration_crc32": "AB", "b_calibration_crc32": "CE"},
         {"certificate_crc32": "AB CD"}, ["hash"]),
        ({"a_report_sha256": "0f", "b_report_sha256": "0f"}, {"certificate_sha256": "0F"}, []),
        ({"a_report_sha256": "", "b_report_sha256": "0f"}, {"certificate_sha256": "0F"}, ["hash"]),
        ({"a_report_sha256": "0e"}, {"certificate_sha256": "0F", "calibration_due": day(0)},
         ["hash", "overdue"]),
        ({}, {"certificate_sha256": "0F", "certificate_crc32": "AB"}, []),
        ({"a_calibration_crc32": "AB", "a_report_sha256": "0f"},
         {"certificate_crc32": "", "certificate_sha256": " "}, []),
    ],
)
def test_a_calibration_is_overdue_or_another_than_the_certificates(
    figures: dict, manifest: dict, kinds: list[str], tmp_path: pathlib.Path
) -> None:
    out = folder(tmp_path, [row("m", 0, **figures), row("m", 1)], [{"machine": "m"} | manifest])
    assert reasons(out) == ({"m": kinds} if kinds else {})


def test_an_empty_check_sum_in_a_manifest_was_another_than_the_certificates(
    tmp_path: pathlib.Path,
) -> None:
    made = synthetic.make(Machine("m", 4, "healthy", 1), tmp_path / "logs", 1, 4.0)
    assert all(made.sums)
    log = next(path for path in (tmp_path / "logs").rglob("*") if path.is_file())
    row_of_it = {"path": str(log), "machine": "m", "certificate_crc32": "", "calibration_due": ""}
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist([row_of_it]), tmp_path / "m.parquet")
    outcome = run(tmp_path / "logs", tmp_path / "out", manifest=tmp_path / "m.parquet")
    assert not outcome.visits
    [known] = query(tmp_path / "out", "from machines").to_pylist()
    assert known["certificate_crc32"] is None and known["calibration_due"] is None


def test_the_list_of_reasons_counted_the_other_way_round_than_their_urgency() -> None:
    page = (ROOT / "docs/fleet.md").read_text()
    found = re.findall(r"^\| `(\w+)` \| (\d) \|", page, re.MULTILINE)
    assert {kind: int(urgency) for kind, urgency in found} == URGENCY
    assert [int(urgency) for _, urgency in found] == sorted(URGENCY.values(), reverse=True)


def test_restarts_count_where_they_are_recent(tmp_path: pathlib.Path) -> None:
    rows = [row(name, number, restart_count=count) for name, days in
            {"new": {18: 2, 19: 1}, "old": {1: 9}, "few": {19: 2}}.items()
            for number, count in ({n: 0 for n in range(20)} | days).items()]
    out = folder(tmp_path, rows)
    assert reasons(out) == {"new": ["restarts"]}
    found = {one["machine"]: one for one in query(out, "restarts").to_pylist()}
    assert (found["old"]["restarts"], found["old"]["recent_restarts"]) == (9, 0)
    assert found["new"]["days_with_restarts"] == 2


def test_silent_days_count_from_the_first_day_to_today(tmp_path: pathlib.Path) -> None:
    rows = [row("here", number) for number in range(10)]
    rows += [row("gap", number) for number in (2, 3, 7, 9)]
    rows += [row("gone", number) for number in (0, 1)] + [row("gone", 9, covered_s=0.0)]
    out = folder(tmp_path, rows)
    found = query(out, "silent").to_pylist()
    assert [(one["machine"], one["silent_days"], one["silent_now"]) for one in found] == [
        ("gone", 8, 8), ("gap", 4, 0),
    ]
    assert reasons(out) == {"gone": ["silent"]}
    assert set(reasons(out, today=day(11))) == {"gone", "gap", "here"}


def test_a_machine_whose_nodes_are_in_no_log_needed_no_visit(tmp_path: pathlib.Path) -> None:
    rows = [row("here", 0), row("other nodes", 0, covered_s=0.0)]
    rows += [row("gone", number, covered_s=3600.0 * (number == 0)) for number in range(2)]
    out = folder(tmp_path, rows)
    assert reasons(out, today=day(0)) == {"other nodes": ["silent"]}
    assert reasons(out, today=day(1)) == {"other nodes": ["silent"]}
    [visit] = visits(out, Rules(today=day(0)))
    assert visit.reasons[0].text == f"no frame of its instruments in any log since {day(0)}"


def test_faults_need_a_visit_where_they_stand_or_come_again(tmp_path: pathlib.Path) -> None:
    rows = [row("once", 9, fault_count=3), row("old", 0, fault_count=9, standing=1)]
    rows += [row("again", number, fault_count=1) for number in (5, 9)]
    rows += [row("stands", 9, fault_count=1, standing=1, standing_text="A: x")]
    rows += [row(name, number) for name in ("once", "old", "stands") for number in (7, 8)]
    rows += [row("old", 9)]
    out = folder(tmp_path, rows)
    assert list(reasons(out)) == ["again", "stands"]


def test_a_question_that_is_none_is_told(tmp_path: pathlib.Path) -> None:
    with pytest.raises(FleetError, match="has no figures of a fleet"):
        query(tmp_path, "faults")
    out = folder(tmp_path, [row("m", 0)])
    for text_of_it in ("select nonsense from figures", "this is no SQL", "select $what"):
        with pytest.raises(FleetError, match="DuckDB can't answer the question"):
            query(out, text_of_it)


@pytest.mark.parametrize("question", ["", "  ", "drft", None])
def test_a_question_that_is_none_gave_a_message_from_inside(
    question: str, tmp_path: pathlib.Path
) -> None:
    listed = ", ".join(QUESTIONS)
    with pytest.raises(FleetError) as refused:
        query(folder(tmp_path, [row("m", 0)]), question)
    assert str(refused.value) == f"{question!r} is no question: give one of {listed}, or SQL"


def test_sql_without_an_answer_gave_a_message_from_inside(tmp_path: pathlib.Path) -> None:
    out = folder(tmp_path, [row("m", 0)])
    with pytest.raises(FleetError, match="^the SQL has no table as its answer: ask by select"):
        query(out, "-- nothing")


@pytest.mark.parametrize(
    ("question", "given", "sentence"),
    [
        ("drift", {"bnd": 3},
         "the question has no parameter bnd: it has band_deg, least_days, today"),
        ("faults", {"bnd": 3}, "the question has no parameter bnd: it has today"),
        ("select 1", {"x": 3}, "the question has no parameter x: it has none"),
        ("select $y", {"x": 3, "y": 1}, "the question has no parameter x: it has y"),
        ("drift", {"band_deg": -1}, "-1 deg is no band: give half of it, more than 0 deg"),
        ("drift", {"band_deg": "1"}, "1 deg is no band: give half of it, more than 0 deg"),
        ("drift", {"least_days": 0}, "least_days is 0: give a whole number of days, 1 or more"),
        ("restarts", {"recent_days": 1.5},
         "recent_days is 1.5: give a whole number of days, 1 or more"),
        ("silent", {"today": "soon"}, "soon is no day such as 2026-11-20"),
        ("silent", {"today": 5}, "5 is no day such as 2026-11-20"),
    ],
)
def test_parameters_that_a_question_can_not_have_were_left_aside_or_taken(
    question: str, given: dict, sentence: str, tmp_path: pathlib.Path
) -> None:
    with pytest.raises(FleetError) as refused:
        query(folder(tmp_path, [row("m", 0)]), question, **given)
    assert str(refused.value) == sentence
    if "no parameter" in sentence:
        return
    with pytest.raises(FleetError) as refused:
        Rules(**given)
    assert str(refused.value) == sentence


def test_a_date_as_today_ended_in_a_type_error(tmp_path: pathlib.Path) -> None:
    out = folder(tmp_path, [row("here", number) for number in range(10)])
    for today in (FIRST + datetime.timedelta(11), datetime.datetime(2026, 9, 12, 8)):
        assert reasons(out, today=today) == reasons(out, today=day(11)) == {"here": ["silent"]}
        assert query(out, "silent", today=today) == query(out, "silent", today=day(11))
    with pytest.raises(FleetError, match="^5 is no day such as 2026-11-20$"):
        Rules(today=5)


def test_what_a_node_answers_about_itself_is_in_the_figures(tmp_path: pathlib.Path) -> None:
    machine = Machine("m", 4, "healthy", 1)
    made = synthetic.make(machine, tmp_path / "logs", 1, 4.0)
    run(tmp_path / "logs", tmp_path / "out")
    [found] = query(tmp_path / "out", "from machine_days").to_pylist()
    assert [found["a_calibration_crc32"], found["b_calibration_crc32"]] == made.sums
    assert found["a_report_sha256"] == ""
    twin = plumb.Twin(seed=4)
    twin.run(1.0)
    wanted = [upload(twin, node, 0x1018, 4) for node in (1, 2)]
    serials = [found["a_serial_number"], found["b_serial_number"]]
    assert serials == [int.from_bytes(one or b"", "little") for one in wanted]
    assert found["firmware"] == (upload(twin, 1, 0x100A, 0) or b"").decode()
    assert found["a_activity_max"] >= 64 and found["a_temperature_degc_mean"] is not None


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """A small synthetic fleet with one machine of each kind, and its results."""
    root = tmp_path_factory.mktemp("synthetic")
    every = [
        Machine(f"m {kind}", 100 + number, kind, 3, 0.8 if kind == "drift" else 0.0)
        for number, kind in enumerate(synthetic.KINDS)
    ]
    made = {one.name: synthetic.make(one, root / "logs", 7, 4.0) for one in every}
    synthetic._write_tables(root, every, made, 7)
    run(root / "logs", root / "out", manifest=root / "manifest.parquet")
    return root


def test_the_visits_of_a_synthetic_fleet_are_those_of_its_truth(fleet: pathlib.Path) -> None:
    truth = pyarrow.parquet.ParquetFile(fleet / "truth.parquet").read().to_pylist()
    wanted = {one["machine"] for one in truth if one["needs_visit"]}
    assert len(truth) == len(synthetic.KINDS) and len(wanted) == len(synthetic.LOUD)
    found = {visit.machine: [one.kind for one in visit.reasons] for visit in visits(fleet / "out")}
    assert set(found) == wanted
    for kind, reason in [
        ("drift", "drift"), ("broken", "fault"), ("loose contact", "fault"),
        ("restarts", "restarts"), ("silent", "silent"), ("overdue", "overdue"),
        ("wrong hash", "hash"),
    ]:
        assert reason in found[f"m {kind}"], found
    page = (fleet / "out/report.html").read_text()
    places = [page.index(f">{visit.machine}</a>") for visit in visits(fleet / "out")]
    assert places == sorted(places) and places[-1] < page.index("Warnings and faults per hour")


def test_a_synthetic_fleet_is_the_same_by_its_seed(tmp_path: pathlib.Path) -> None:
    for name in ("one", "two"):
        words = ["--machines", "2", "--days", "3", "--seed", "5", "--seconds", "4"]
        command = [sys.executable, "-m", "plumb.fleet.synthetic", str(tmp_path / name), *words]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr

    def contents(name: str) -> dict[str, bytes]:
        files = [path for path in (tmp_path / name).rglob("*") if path.is_file()]
        return {str(path.relative_to(tmp_path / name)): path.read_bytes() for path in files}

    assert contents("one") == contents("two") and len(contents("one")) == 8


def test_a_log_without_an_instrument_is_a_day_without_figures(tmp_path: pathlib.Path) -> None:
    put(tmp_path / "logs/m/2026-11-20.log", "(1795168800.000000) can0 123#00\n" * 3)
    put(tmp_path / "logs/n/2026-11-20.log", text("2026-11-20"))
    run(tmp_path / "logs", tmp_path / "out")
    found = query(tmp_path / "out", "select machine, instrument, covered_s from figures").to_pylist()
    assert found[0] == {"machine": "m", "instrument": 0, "covered_s": 0.0} and len(found) == 2
