"""The script in README, run as it stands there."""

from __future__ import annotations

import pathlib
import re
import socket
import subprocess
import sys
from typing import Iterator

import pytest
from master import PLUMB, ROOT, until

SCRIPT = ROOT / "interop" / "read_angle.py"


def port_is_free() -> bool:
    """Whether nobody serves where the script looks."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", 29536)) != 0


@pytest.fixture
def serving(tmp_path: pathlib.Path) -> Iterator[None]:
    """`plumb serve` with its default options; only the motion is the test's."""
    if not port_is_free():
        pytest.skip("port 29536 is in use: end the `plumb serve` that runs there")
    words = tmp_path / "words"
    words.write_text("rate 90\nroll -10\npitch 20\nhold\n")
    command = [PLUMB, "serve", "--no-stdin", "--script", str(words)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    # Its second line comes with the first, and then the client may connect.
    assert process.stdout.readline().startswith("serving 2 nodes (1, 2) at 250 kbit/s")
    yield
    process.kill()
    process.wait()


def run_script() -> tuple[float, float]:
    """Runs the script in the root of the checkout; the two angles it prints."""
    command = [sys.executable, str(SCRIPT)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    printed = re.fullmatch(r"slope X (-?[\d.]+) deg, slope Y (-?[\d.]+) deg\n", done.stdout)
    return float(printed[1]), float(printed[2])


def test_the_script_reads_the_angles(serving: None) -> None:
    # It may come while the housing still turns, but never sees a value that isn't an angle.
    x, y = run_script()
    assert -11 < x < 1 and -1 < y < 21

    def there() -> bool:
        x, y = run_script()
        # 0.2 deg: what is left after the calibration, and noise.
        return abs(x + 10) < 0.2 and abs(y - 20) < 0.2

    until(there, "the angles of the script of motion", 10)


def test_the_script_has_ten_lines_at_most() -> None:
    assert len(SCRIPT.read_text().splitlines()) <= 10


def test_the_readme_shows_the_script_as_it_is() -> None:
    readme = (ROOT / "README.md").read_text()
    assert f"```python\n{SCRIPT.read_text()}```" in readme
