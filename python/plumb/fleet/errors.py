"""What a run over a fleet ends with when it can't be done."""

from __future__ import annotations

from .._plumb import Error


class FleetError(Error):
    """A run over a fleet could not be done; the text is one sentence with what to do."""


def first_line(why: BaseException) -> str:
    """The first line of another library's message."""
    lines = str(why).strip().splitlines()
    return lines[0].rstrip(".") if lines else type(why).__name__
