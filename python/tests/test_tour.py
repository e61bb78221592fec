"""The tour of docs/python.md runs as it stands."""

from __future__ import annotations

import pathlib
import re

import pytest
from conftest import ROOT

TOUR = ROOT / "docs" / "python.md"


def test_the_scripts_of_the_tour_run(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scripts = re.findall(r"^```python\n(.*?)^```$", TOUR.read_text(), re.DOTALL | re.MULTILINE)
    assert len(scripts) >= 6
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for script in scripts:
        exec(compile(script, str(TOUR), "exec"), names)
    said = capsys.readouterr().out
    assert re.search(r"EMCY FF\d\dh", said) and "nothing skipped" in said, said
    assert "the filter settles until sample 127" in said, said
    assert b"deg" in names["table"].schema.field("slope_x_deg").metadata.values()
    assert "3 machines, 24 machine-days" in said and "crane 2 needs a visit: A \u2212 B" in said, said
    assert (tmp_path / "fleet.png").stat().st_size > 5_000
    assert (tmp_path / "fault.png").stat().st_size > 5_000
