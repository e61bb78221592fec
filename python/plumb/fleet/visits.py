"""Which machines need a visit, and why.

In: the answers to the questions of `queries/`. Out: a `Visit` for each such machine, the most
urgent first. The rules are `Rules`; docs/fleet.md describes them.
"""

from __future__ import annotations

import datetime
import os
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from .asking import Figures, day_in, refuse_parameters
from .errors import FleetError


@dataclass(frozen=True)
class Rules:
    """When a machine needs a visit."""

    today: str | datetime.date | None = None
    """The day that all is seen from, as 2026-11-20 or a date; None for the last day with data."""
    recent_days: int = 7
    """Days until today that count as recent."""
    fault_days: int = 2
    """So many recent days with a fault, though it is over."""
    restarts: int = 3
    """So many recent restarts."""
    silent_days: int = 2
    """So many days without data until today."""
    drift_days: int = 30
    """A drift that leaves the band within so many days."""
    least_days: int = 5
    """Days that a line of drift needs."""
    band_deg: float | None = None
    """Half the band of A - B, deg; None for the expanded uncertainty of the difference."""

    def __post_init__(self) -> None:
        refuse_parameters(self.parameters())

    def parameters(self) -> dict[str, Any]:
        """What the questions are given."""
        given: dict[str, Any] = {
            "recent_days": self.recent_days,
            "least_days": self.least_days,
            "band_deg": self.band_deg,
        }
        # What is no day is refused as it was given.
        return given if self.today is None else given | {"today": day_in(self.today) or self.today}


@dataclass(frozen=True)
class Reason:
    """Why a machine needs a visit."""

    machine: str
    kind: str
    """fault, silent, drift, restarts, hash or overdue."""
    urgency: int
    """Greater is sooner."""
    text: str


URGENCY = {"fault": 6, "silent": 5, "drift": 4, "hash": 3, "restarts": 2, "overdue": 1}
"""Which reason comes before which."""


@dataclass(frozen=True)
class Visit:
    """A machine that needs a visit."""

    machine: str
    reasons: tuple[Reason, ...]
    """The most urgent first."""

    @property
    def urgency(self) -> int:
        """That of its most urgent reason."""
        return self.reasons[0].urgency


def visits(out: str | os.PathLike[str], rules: Rules = Rules()) -> list[Visit]:
    """The machines of the folder `out` that need a visit, the most urgent first."""
    refuse_other_rules(rules)
    with Figures(out) as figures:
        return found(figures, rules)


def refuse_other_rules(given: object) -> None:
    """Refuses what are no rules.

    Errors: `FleetError`.
    """
    if not isinstance(given, Rules):
        raise FleetError(f"rules is {given!r}: give plumb.fleet.Rules")


def found(figures: Figures, rules: Rules) -> list[Visit]:
    """The same of figures that are open."""
    reasons: dict[str, list[Reason]] = defaultdict(list)
    for judge in (_faults, _silence, _drift, _calibration, _restarts):
        for machine, kind, text in judge(figures, rules):
            reasons[machine].append(Reason(machine, kind, URGENCY[kind], text))
    all_of_them = [
        Visit(machine, tuple(sorted(set(why), key=lambda one: (-one.urgency, one.text))))
        for machine, why in reasons.items()
    ]
    key = lambda visit: (-visit.urgency, -len(visit.reasons), visit.machine)  # noqa: E731
    return sorted(all_of_them, key=key)


Found = Iterator[tuple[str, str, str]]


def _faults(figures: Figures, rules: Rules) -> Found:
    for row in figures.rows("standing", **rules.parameters()):
        if row["standing"]:
            text = f"a fault stands at the end of {row['last_day']}: {row['standing_text']}"
            yield row["machine"], "fault", text
        elif row["days_with_faults"] >= rules.fault_days:
            text = f"faults on {row['days_with_faults']} of the last {rules.recent_days} days"
            yield row["machine"], "fault", text


def _silence(figures: Figures, rules: Rules) -> Found:
    for row in figures.rows("silent", **rules.parameters()):
        if row["last_day"] is None:
            text = f"no frame of its instruments in any log since {row['first_day']}"
            yield row["machine"], "silent", text
        elif row["silent_now"] >= rules.silent_days:
            text = f"no data for {row['silent_now']} days, since {row['last_day']}"
            yield row["machine"], "silent", text


def _drift(figures: Figures, rules: Rules) -> Found:
    for row in figures.rows("drift", **rules.parameters()):
        axis = f"A \u2212 B of slope {row['axis'].upper()}"
        slope = f"{row['deg_per_day']:+.4f} \u00b1 {2 * row['deg_per_day_error']:.4f} deg/day"
        if row["outside"]:
            band = f"\u00b1{row['band_deg']:.3f} deg"
            text = f"{axis} is {row['level_deg']:+.3f} deg, outside its band of {band}"
            yield row["machine"], "drift", text
        elif row["leaves_on"] and _days_until(row) <= rules.drift_days:
            text = f"{axis} drifts by {slope} and leaves its band on {row['leaves_on']}"
            yield row["machine"], "drift", text


def _days_until(row: dict[str, Any]) -> int:
    until: datetime.timedelta = row["leaves_on"] - row["last_day"]
    return until.days


def _calibration(figures: Figures, rules: Rules) -> Found:
    for row in figures.rows("calibration", **rules.parameters()):
        if row["other_calibration"]:
            yield row["machine"], "hash", "the calibration is not that of its certificate"
        elif row["other_report"]:
            yield row["machine"], "hash", "the report's hash is not that of its certificate"
        if row["overdue"]:
            yield row["machine"], "overdue", f"the calibration was due on {row['due']}"


def _restarts(figures: Figures, rules: Rules) -> Found:
    for row in figures.rows("restarts", **rules.parameters()):
        if (row["recent_restarts"] or 0) >= rules.restarts:
            text = f"{row['recent_restarts']} restarts in the last {rules.recent_days} days"
            yield row["machine"], "restarts", text
