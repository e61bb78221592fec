"""What a run over a fleet ends with when it can't be done."""

from __future__ import annotations

from .._plumb import Error


class FleetError(Error):
    """A run over a fleet could not be done; the text is one sentence with what to do."""
