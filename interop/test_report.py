"""The calibration report as others read it: dcc.xml by PTB's schema and rules, in `dcclib`."""

from __future__ import annotations

import pathlib
import re
import subprocess
from typing import Iterator

import dcclib
import pytest
from dcclib.validation.schematron import SchematronValidator
from dcclib.validation.xsd import XsdValidator
from lxml import etree
from master import PLUMB, Plumb

pytestmark = pytest.mark.virtual("it is about the program plumb")

# What its rules report of every document of 3.2.1, which is what laboratories use today.
OUTDATED = "@schemaVersion='3.3.0'"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Iterator[pathlib.Path]:
    """The folder of a calibration by motor."""
    folder = tmp_path_factory.mktemp("report")
    serve = ("--motor", "127.0.0.1:0", "--speed", "20", "--bit-rate", "1000", "--uncalibrated")
    with Plumb(*serve) as plumb:
        motor = re.search(r"tcp://\S+", plumb.printed("calibrate --motor"))[0]
        command = [PLUMB, "calibrate", "--motor", motor, "--bus", f"127.0.0.1:{plumb.port}"]
        command += ["--step", "15", "--country", "IT", "--laboratory", "<Müller> & Söhne"]
        subprocess.run([*command, "--out", str(folder)], check=True, timeout=600)
        yield folder


# Pitch and roll in each pose that is asked for by hand, the verification's two behind them.
STANDS = [
    (0.3, -0.4), (-0.3, 0.4), (0, 89.6), (0, 90.4), (0, -90), (90, 0), (-90, 0), (0, 179.6),
    (0, 41), (0, -48), (42, 0), (-47, 0), (41, 47), (0.2, 0.3), (-0.2, -0.3),
]  # fmt: skip


@pytest.fixture(scope="module")
def by_hand(tmp_path_factory: pytest.TempPathFactory) -> Iterator[pathlib.Path]:
    """The folder of a calibration by hand."""
    folder = tmp_path_factory.mktemp("by-hand")
    with Plumb("--speed", "20", "--bit-rate", "1000") as plumb:
        command = [PLUMB, "calibrate", "--by-hand", "--bus", f"127.0.0.1:{plumb.port}"]
        command += ["--country", "IT", "--out", str(folder)]
        pipe = subprocess.PIPE
        run = subprocess.Popen(command, stdin=pipe, stderr=pipe, text=True, bufsize=1)
        stands = iter(STANDS)
        for line in run.stderr:
            if line.startswith(("pose ", "verification, ")):
                pitch, roll = next(stands)
                # Not by `turn`, which waits for a slope that folds beyond 90 deg.
                plumb.type("rate 400", "level", f"pitch {pitch}", f"roll {roll}")
                plumb.rest(0.5)
                run.stdin.write("\n")
        assert run.wait(60) == 0
        yield folder


@pytest.fixture(params=["report", "by_hand"])
def folder(request: pytest.FixtureRequest) -> pathlib.Path:
    """The folder of either."""
    return request.getfixturevalue(request.param)


def test_the_schema_accepts_the_report(folder: pathlib.Path) -> None:
    result = XsdValidator.from_auto_detection().validate_file(str(folder / "dcc.xml"))
    assert result.is_valid, result.errors


def test_the_rules_find_nothing_but_the_release(folder: pathlib.Path) -> None:
    rules = pathlib.Path(dcclib.__file__).parent / "validation" / "schema" / "dcc.sch"
    result = SchematronValidator.from_file(str(rules)).validate_file(str(folder / "dcc.xml"))
    found = [*result.failed_assertions, *result.successful_reports]
    bad = [f for f in found if f.role != "information" and f.test != OUTDATED]
    assert not bad, bad


def test_names_arrive_as_they_were_given(report: pathlib.Path) -> None:
    tree = etree.parse(str(report / "dcc.xml"))
    names = tree.findall(".//{https://ptb.de/dcc}calibrationLaboratory//{*}content")
    assert [name.text for name in names] == ["<Müller> & Söhne"]
