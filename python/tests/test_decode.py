"""The rows of `decode` are those that the program exports."""

from __future__ import annotations

import csv
import gzip
import math
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import threading

import pyarrow
import pyarrow.compute
import pyarrow.parquet
import pytest
from conftest import ROOT, candump, interrupted, run, sentence, shift

import plumb


def exported(program: pathlib.Path, path: pathlib.Path, *words: object) -> list[dict[str, str]]:
    """The rows of the CSV that the program makes of a log."""
    table = path.parent / "export.csv"
    done = run(program, "replay", path, "--export", table, "--force", *words)
    assert table.exists(), done.stderr
    with table.open(newline="") as file:
        return list(csv.DictReader(file))


def same(row: dict[str, object], text: dict[str, str]) -> bool:
    """Whether a row has the values of a line of the CSV, the time to the last bit but one."""

    def value(name: str, cell: str) -> object:
        if name in ("interface", "message"):
            return cell
        return None if cell == "" else float(cell)

    wanted = {name: value(name, cell) for name, cell in text.items()}
    off = abs(row["time_s"] - wanted["time_s"])
    return off <= math.ulp(wanted["time_s"]) and row | {"time_s": 0} == wanted | {"time_s": 0}


@pytest.mark.filterwarnings("ignore::plumb.IncompleteWarning")
def test_every_row_is_the_export_s(program: pathlib.Path, log: pathlib.Path) -> None:
    wanted = exported(program, log)
    rows = plumb.decode(log).read_all().to_pylist()
    assert len(rows) == len(wanted) > 2500
    assert list(rows[0]) == list(wanted[0])
    different = [pair for pair in zip(rows, wanted) if not same(*pair)]
    assert not different, different[0]
    assert {row["message"] for row in rows} >= {"slopes", "detail", "exchange", "emcy", "heartbeat"}


@pytest.mark.filterwarnings("ignore::plumb.IncompleteWarning")
def test_the_table_is_that_of_the_parquet_file(program: pathlib.Path, log: pathlib.Path) -> None:
    path = log.parent / "export.parquet"
    run(program, "replay", log, "--export", path, "--force")
    wanted = pyarrow.parquet.read_table(path)
    table = plumb.decode(log).read_all()
    assert table.replace_schema_metadata().cast(wanted.schema).equals(wanted)


def test_another_node_s_data_sheet_has_columns_of_its_own(
    program: pathlib.Path, log: pathlib.Path
) -> None:
    path = log.parent / "other.log"
    path.write_text("(1790000000.000000) can0 185#3412\n(1790000000.100000) can0 185#FFFF\n")
    sheet = log.parent / "valve.eds"
    text = (
        "[DeviceInfo]\nProductName=Valve\n[1800]\nParameterName=TPDO\nObjectType=0x9\nSubNumber=2\n"
        "[1800sub0]\nParameterName=n\nObjectType=0x7\nDataType=5\nAccessType=ro\nDefaultValue=1\n"
        "[1800sub1]\nParameterName=id\nObjectType=0x7\nDataType=7\nAccessType=rw\n"
        "DefaultValue=0x185\n[1A00]\nParameterName=map\nObjectType=0x9\nSubNumber=2\n"
        "[1A00sub0]\nParameterName=n\nObjectType=0x7\nDataType=5\nAccessType=rw\nDefaultValue=1\n"
        "[1A00sub1]\nParameterName=m\nObjectType=0x7\nDataType=7\nAccessType=rw\n"
        "DefaultValue=0x60000010\n[6000]\nParameterName=Opening\nObjectType=0x7\nDataType=3\n"
        "AccessType=ro\nPDOMapping=1\n"
    )
    sheet.write_text(text)
    wanted = exported(program, path, "--eds", f"{sheet}@5")
    rows = plumb.decode(path, f"{sheet}@5").read_all().to_pylist()
    assert [row["node5_opening"] for row in rows] == [0x1234, -1]
    assert all(same(*pair) for pair in zip(rows, wanted)) and len(rows) == len(wanted)


def test_units_stand_in_the_metadata_of_the_fields(log: pathlib.Path) -> None:
    reader = pyarrow.RecordBatchReader.from_stream(plumb.decode(log))
    units = {field.name: (field.metadata or {}).get(b"unit") for field in reader.schema}
    assert units["time_s"] == b"s" and units["latency_ms"] == b"ms"
    assert units["slope_x_deg"] == b"deg" and units["rate_z_deg_s"] == b"deg/s"
    assert units["temperature_degc"] == b"degC" and units["accel_x_g"] == b"g"
    assert units["state"] is None and units["message"] is None


def test_what_is_damaged_is_counted_as_the_program_does(
    program: pathlib.Path, log: pathlib.Path
) -> None:
    decoded = plumb.decode(log)
    with pytest.warns(plumb.IncompleteWarning) as told:
        batches = list(decoded)
    said = sentence(program, "replay", log)
    assert [str(warning.message) for warning in told] == [said] == [decoded.incomplete]
    lines = log.read_text().splitlines()
    line = lines.index("this is no frame") + 1
    [skipped] = decoded.skipped
    assert skipped == plumb.Skipped("lines that can't be read", 1, str(log), line)
    assert decoded.frames == len(lines) - 1 and decoded.files == [str(log)]
    assert sum(batch.num_rows for batch in batches) > 2500


def test_folders_gzip_and_parts_are_read_as_the_program_does(
    program: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    folder = tmp_path / "day"
    folder.mkdir()
    frames = shift(5, 3.0)
    half = len(frames) // 2
    (folder / "one.log").write_text(candump(frames[:half]))
    (folder / "two.log.gz").write_bytes(gzip.compress(candump(frames[half:]).encode()))
    (folder / "notes.txt").write_text("nothing of a bus\n")
    decoded = plumb.decode(folder)
    rows = decoded.read_all().to_pylist()
    assert [pathlib.Path(name).name for name in decoded.not_logs] == ["notes.txt"]
    assert decoded.frames == len(frames) and decoded.incomplete is None
    wanted = exported(program, folder)
    assert len(rows) == len(wanted) and all(same(*pair) for pair in zip(rows, wanted))
    part = plumb.decode(folder, begin="1", end="2").read_all().to_pylist()
    wanted = exported(program, folder, "--from", 1, "--to", 2)
    assert 0 < len(part) < len(rows) and len(part) == len(wanted)
    cut = tmp_path / "cut.log.gz"
    cut.write_bytes((folder / "two.log.gz").read_bytes()[:-400])
    decoded = plumb.decode(cut)
    with pytest.warns(plumb.IncompleteWarning, match="the end of .*cut.log.gz is missing"):
        decoded.read_all()
    assert len(decoded.damaged) == 1


def test_a_log_can_be_read_once(log: pathlib.Path) -> None:
    decoded = plumb.decode(log)
    batches = iter(decoded)
    next(batches)
    with pytest.raises(plumb.Error, match="was read already"):
        decoded.read_all()


@pytest.mark.filterwarnings("ignore::plumb.IncompleteWarning")
def test_duckdb_asks_for_the_schema_first_and_had_used_the_log_up_with_it(
    log: pathlib.Path,
) -> None:
    import duckdb

    table = plumb.decode(log).read_all()
    decoded = plumb.decode(log)
    assert duckdb.sql("select count(*) from decoded").fetchall() == [(table.num_rows,)]
    assert decoded.frames > 0 and decoded.incomplete is not None
    registered = duckdb.connect().register("rows", plumb.decode(log))
    [(angle,)] = registered.execute("select max(angle_x_deg) from rows").fetchall()
    assert angle == pyarrow.compute.max(table["angle_x_deg"]).as_py()
    again = plumb.decode(log)
    assert duckdb.sql("describe from again").fetchall()[0][0] == "time_s" and again.frames == 0
    with pytest.raises(duckdb.Error, match="this log was read already; decode it again"):
        duckdb.sql("select count(*) from decoded").fetchall()


@pytest.mark.filterwarnings("ignore::plumb.IncompleteWarning")
def test_of_several_streams_one_has_the_rows(log: pathlib.Path) -> None:
    decoded = plumb.decode(log)
    one, two = (pyarrow.RecordBatchReader.from_stream(decoded) for _ in range(2))
    assert one.schema == two.schema
    assert two.read_all().num_rows > 2500
    with pytest.raises((pyarrow.ArrowException, OSError), match="was read already"):
        one.read_all()


def test_other_threads_go_on_while_a_log_is_read(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "long.log"
    text = candump(shift(6, 2.0))
    path.write_text(text * 60)
    ticks = 0
    stop = threading.Event()

    def tick() -> None:
        nonlocal ticks
        while not stop.wait(0.001):
            ticks += 1

    def during_a_read() -> int:
        before = ticks
        plumb.decode(path).read_all()
        return ticks - before

    thread = threading.Thread(target=tick)
    thread.start()
    # Hundreds where the machine is idle; one at either end where the interpreter stood still. The
    # best of some counts: a busy machine may give the other thread no time in one of them.
    found = [during_a_read() for _ in range(5)]
    stop.set()
    thread.join()
    assert max(found) >= 10, found


# Reads a log batch by batch; the rows, and how much memory the process has had at most, kB. What
# getrusage reports would be at least what the process that has started this one has.
READER = """
import pathlib, re, sys, plumb
rows = sum(batch.num_rows for batch in plumb.decode(sys.argv[1]))
status = pathlib.Path("/proc/self/status").read_text()
print(rows, re.search(r"VmHWM:\\s+(\\d+) kB", status)[1])
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel tells it under Linux alone")
def test_memory_does_not_grow_with_the_log(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "long.log"
    text = candump(shift(6, 8.0))
    found = []
    for times in (80, 400):
        path.write_text(text * times)
        command = [sys.executable, "-c", READER, str(path)]
        said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        found.append([int(number) for number in said.split()])
    (few, some_kb), (many, more_kb) = found
    # Eight hundred thousand rows more, which would be 200 MB; a batch has 16.
    assert many == 5 * few > 1_000_000
    assert more_kb - some_kb < 40_000, found


@pytest.mark.parametrize("name", ["nowhere.log", "empty", "README.md", "log.blf"])
def test_bad_input_is_told_by_the_program_s_sentence(
    name: str, program: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    path = tmp_path / name
    if name == "empty":
        path.mkdir()
    if name == "README.md":
        shutil.copy(ROOT / name, path)
    if name == "log.blf":
        path.write_bytes(b"LOGG" + bytes(200))
    with pytest.raises(plumb.Error) as told:
        plumb.decode(path).read_all()
    # What is no log is taken for a recording by the program's replay, but not by its report.
    said = sentence(program, "report", path, "--out", tmp_path / "out")
    assert str(told.value) == said and "\n" not in said


@pytest.mark.parametrize(
    "words", [{"begin": "soon"}, {"nodes": [1]}, {"nodes": [1, 200]}, {"channel": "can7"}]
)
def test_options_that_are_wrong_are_told_in_a_sentence(words: dict, log: pathlib.Path) -> None:
    with pytest.raises(plumb.Error) as told:
        plumb.decode(log, **words).read_all()
    assert len(str(told.value).splitlines()) == 1, told.value


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ({"begin": "xx"}, 'begin is "xx": give seconds since its start, or a date as'),
        ({"end": "-1"}, 'end is "-1": give seconds since its start, or a date as'),
        ({"begin": [1]}, "begin is [1]: give seconds, or a date as '2026-11-22T12:30:00'"),
        ({"channel": 0}, "channel is 0: give the name of an interface, such as 'can0'"),
    ],
)
def test_a_time_that_is_none_was_told_without_the_argument_and_its_value(
    words: dict, sentence: str, log: pathlib.Path
) -> None:
    with pytest.raises(plumb.Error) as told:
        plumb.decode(log, **words)
    assert str(told.value).startswith(sentence), told.value


@pytest.mark.filterwarnings("ignore::plumb.IncompleteWarning")
def test_begin_and_end_may_be_numbers(log: pathlib.Path) -> None:
    wanted = plumb.decode(log, begin="1", end="2.5").read_all()
    assert plumb.decode(log, begin=1, end=2.5).read_all() == wanted and wanted.num_rows > 0


def test_the_first_line_of_an_open_file_was_taken_for_a_path(log: pathlib.Path) -> None:
    for mode in ("r", "rb"):
        with log.open(mode) as file, pytest.raises(plumb.Error, match="^an open file was given in"):
            plumb.decode(file)
    for given in (5, b"machine.log", [5], [b"machine.log"]):
        for what in (plumb.decode, plumb.summarise):
            with pytest.raises(plumb.Error, match=" is no path: give one, or a list of them$"):
                what(given)


def test_frames_of_others_alone_kept_ctrl_c_waiting_for_the_end(tmp_path: pathlib.Path) -> None:
    # Signals are handled between two batches.
    path = tmp_path / "others.log"
    path.write_text("(1790000000.000000) can0 7FF#\n" * 2_200_000)
    rows = [batch.num_rows for batch in plumb.decode(path)]
    assert rows == [0, 0]


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="there is no such signal")
def test_ctrl_c_waited_for_the_writer_of_a_pipe(tmp_path: pathlib.Path) -> None:
    pipe = tmp_path / "nobody.log"
    os.mkfifo(pipe)
    with interrupted(0.2):
        plumb.decode(pipe)
