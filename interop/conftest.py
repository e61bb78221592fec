"""What every test file may ask for: `joined` and `master` (a file brings its own `plumb`).

Tests marked `virtual` need what only the host's build of a node has, as each states; they are left
out where `PLUMB` is the program that runs the exact image on emulated boards. Tests marked
`product` need what the paper's instrument has not; they are left out where `PLUMB_MODE` is paper.
Tests marked `accelerometer` need angles of an accelerometer alone; they are left out where it is
dynamic. Tests marked `sheets` need objects that the paper's image has not, and the virtual
instrument has.
"""

from __future__ import annotations

import pytest
from master import EMULATED, MODE, joined, master

__all__ = ["joined", "master"]


# Marks of tests that are left out here.
LEFT_OUT = [
    *["virtual"] * EMULATED,
    *["product"] * (MODE == "paper"),
    *["accelerometer"] * (MODE == "dynamic"),
    *["sheets"] * (EMULATED and MODE == "paper"),
]


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "virtual(why): only for the host's build of a node")
    config.addinivalue_line("markers", "product(why): only for product mode")
    config.addinivalue_line("markers", "accelerometer(why): not for the variant with a gyroscope")
    config.addinivalue_line("markers", "sheets(why): not for the paper's image")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    left_out = [item for item in items if any(map(item.get_closest_marker, LEFT_OUT))]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in left_out]
