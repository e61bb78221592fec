"""What every test file may ask for: `joined` and `master` (a file brings its own `plumb`).

Tests marked `virtual` need what only the host's build of a node has, as each says; they are left
out where `PLUMB` is the program that runs the exact image on emulated boards.
"""

from __future__ import annotations

import pytest
from master import EMULATED, joined, master

__all__ = ["joined", "master"]


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "virtual(why): only for the host's build of a node")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if not EMULATED:
        return
    left_out = [item for item in items if item.get_closest_marker("virtual")]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in left_out]
