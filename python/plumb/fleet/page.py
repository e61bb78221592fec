"""The page of a fleet, and the period page of each machine that needs a visit.

In: the tables of a `Store`. Out: `report.html` and `report.json` in its folder, drawn by the code
of the other reports, and `machines/NAME/report.html`. The same tables give the same bytes.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import pathlib
import urllib.parse
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from .. import _plumb
from .asking import Figures, sql
from .scratch import Told
from .store import REPORTS, Store, remove_made
from .visits import Rules, Visit
from .visits import found as visits

FORMAT = "plumb-fleet"
VERSION = 1

ROWS = 60
"""Rows of a table that are shown; the Parquet has them all."""

LONGEST = 200
"""Bytes of a folder's name."""

MERGED = 16
"""Days of a machine that are merged at once."""

DRAWN = 4
"""Machines whose drift is drawn."""

Row = dict[str, Any]


@dataclass(frozen=True)
class Made:
    """The page."""

    path: pathlib.Path
    verdict: str
    visits: list[str]


def folder_of(machine: str) -> str:
    """A machine's folder in `machines/`: its name, what a file system might refuse replaced."""
    safe = urllib.parse.quote(machine, safe=" +,-=@_()[]äöüÄÖÜß")
    if safe.strip(". ") == "" or safe.endswith("."):
        safe = safe.replace(".", "%2E").replace(" ", "%20")
    if len(safe.encode()) > LONGEST:
        return safe[: LONGEST // 4] + "-" + hashlib.sha256(machine.encode()).hexdigest()[:16]
    return safe


def write(store: Store, rules: Rules, told: Told) -> Made:
    """Makes the page of what the folder holds; the pages of machines stand before it.

    `told` has up to `ROWS` of the lines with a sentence.
    """
    with Figures(store.folder, lean=True) as figures:
        found = visits(figures, rules)
        report = _report(figures, rules, found, told)
    for visit in found:
        target = store.folder / "machines" / folder_of(visit.machine)
        _plumb.report(_whole(store.summaries(visit.machine)), str(target), None)
    html, _ = _plumb.fleet_page(json.dumps(report).encode(), str(store.folder))
    _remove_others(store.folder / "machines", {folder_of(visit.machine) for visit in found})
    return Made(pathlib.Path(html), report["verdict"], [visit.machine for visit in found])


def _whole(summaries: Iterator[bytes]) -> bytes:
    """All of them merged, some at a time: the same bytes in any grouping."""
    some = list(itertools.islice(summaries, MERGED))
    whole = _plumb.merge(some)
    while some := list(itertools.islice(summaries, MERGED)):
        whole = _plumb.merge([whole, *some])
    return whole


def _remove_others(folder: pathlib.Path, wanted: set[str]) -> None:
    if folder.is_dir():
        for entry in os.scandir(folder):
            if entry.name not in wanted:
                remove_made(pathlib.Path(entry.path), REPORTS)


def _report(figures: Figures, rules: Rules, found: list[Visit], told: Told) -> Row:
    def ask(question: str) -> Iterator[Row]:
        return figures.rows(question, **rules.parameters())

    [total] = figures.rows(TOTAL)
    known = _known(figures, [visit.machine for visit in found])
    return {
        "format": FORMAT,
        "version": VERSION,
        "verdict": _verdict(total, found, told),
        "clean": not found and not told.bad,
        "from": total["first_day"].isoformat(),
        "to": total["last_day"].isoformat(),
        "facts": _facts(total, told),
        "visits": [_visit(visit, known.get(visit.machine, {})) for visit in found],
        "sections": [
            _faults(ask("faults")),
            _drift(figures, ask("drift")),
            _histories(figures, rules),
            _calibration(figures, ask("calibration")),
            _restarts(ask("restarts"), ask("silent")),
            _logs(told),
        ],
    }


TOTAL = """select count(distinct machine) as machines, count(distinct date) as days,
    min(date) as first_day, max(date) as last_day, sum(covered_s) / 3600 as hours,
    sum(incidents) as incidents, count(distinct (machine, date)) as machine_days
    from machine_days"""

KNOWN = """select machine, arg_max(model, day) as model, arg_max(firmware, day) as firmware
    from machine_days where list_contains($machines, machine) group by machine"""


def _known(figures: Figures, machines: list[str]) -> dict[str, Row]:
    """Model and firmware of these machines."""
    if not machines:
        return {}
    return {row["machine"]: row for row in figures.rows(KNOWN, machines=machines)}


def _plural(count: int, one: str, many: str) -> str:
    return f"{count} {one if count == 1 else many}"


def _verdict(total: Row, found: list[Visit], told: Told) -> str:
    machines = _plural(total["machines"], "machine", "machines")
    who = f"{machines}, {total['machine_days']} machine-days, {total['hours']:.1f} h of data, "
    incidents = _plural(int(total["incidents"] or 0), "incident", "incidents")
    if not found:
        need = "no machine needs a visit"
    else:
        need = _plural(len(found), "machine needs a visit", "machines need a visit")
    text = f"{who}{incidents}; {need}."
    if told.bad:
        text += f" {_plural(told.bad, 'log', 'logs')} could not be read, or not to the end."
    return text


def _facts(total: Row, told: Told) -> list[list[str]]:
    return [
        ["Machines", str(total["machines"])],
        ["Logs", str(told.counted)],
        ["Frames", f"{told.frames:,}".replace(",", "\u2009")],
        ["With data", f"{total['hours']:.1f} h"],
    ]


def _visit(visit: Visit, known: Row) -> Row:
    place = urllib.parse.quote(folder_of(visit.machine))
    return {
        "machine": visit.machine,
        "model": known.get("model"),
        "firmware": known.get("firmware"),
        "urgency": visit.urgency,
        "page": f"machines/{place}/report.html",
        "reasons": [{"kind": reason.kind, "text": reason.text} for reason in visit.reasons],
    }


Column = tuple[str, Callable[[Row], Any], int | None]
"""Name, value of a row, and decimals of a number or None for text."""


@dataclass
class First:
    """The first `ROWS` rows of many, and how many there are."""

    rows: list[Row] = field(default_factory=list)
    count: int = 0

    def add(self, row: Row) -> None:
        """One more."""
        self.count += 1
        if len(self.rows) < ROWS:
            self.rows.append(row)

    @staticmethod
    def of(rows: Iterable[Row]) -> First:
        """Those of all rows."""
        first = First()
        for row in rows:
            first.add(row)
        return first


def _table(title: str, first: First, columns: list[Column], note: str = "") -> Row:
    def cell(row: Row, column: Column) -> str:
        value = column[1](row)
        if value is None:
            return "-"
        return str(value) if column[2] is None else f"{value:.{column[2]}f}"

    notes = [note] if note else []
    if first.count > ROWS:
        notes.append(f"{first.count - ROWS} more in the tables of the folder.")
    return {
        "title": title,
        "columns": [{"name": name, "number": places is not None} for name, _, places in columns],
        "rows": [[cell(row, column) for column in columns] for row in first.rows],
        "notes": notes,
    }


def _of(name: str, scale: float = 1.0) -> Callable[[Row], Any]:
    def value(row: Row) -> Any:
        found = row[name]
        return found if found is None or scale == 1.0 else found * scale

    return value


def _section(title: str, text: list[str], tables: list[Row], charts: list[Row] = []) -> Row:
    kept = [table for table in tables if table["rows"]]
    return {"title": title, "text": text, "charts": charts, "tables": kept}


def _faults(rows: Iterable[Row]) -> Row:
    columns: list[Column] = [
        ("Name", _of("name"), None),
        ("Machines", _of("machines"), 0),
        ("Hours", _of("hours"), 2),
        ("Warnings", _of("warnings"), 0),
        ("Faults", _of("faults"), 0),
        ("Incidents", _of("incidents"), 0),
        ("Warnings per hour", _of("warnings_per_hour"), 3),
        ("Faults per hour", _of("faults_per_hour"), 3),
        ("Incidents per hour", _of("incidents_per_hour"), 3),
    ]
    groups = {key: First() for key in ("model", "firmware", "machine")}
    quiet = 0
    for row in rows:
        key = row["grouped_by"]
        if key != "machine" or row["warnings"] or row["faults"]:
            groups[key].add(row)
        else:
            quiet += 1
    notes = dict.fromkeys(groups, "Both channels report most faults; an incident counts once.")
    notes["machine"] = f"{quiet} machines have neither warnings nor faults."
    tables = [_table(f"By {key}", own, columns, notes[key]) for key, own in groups.items()]
    return _section("Warnings and faults per hour", [], tables)


def _drift(figures: Figures, rows: Iterable[Row]) -> Row:
    columns: list[Column] = [
        ("Machine", _of("machine"), None),
        ("Instrument", _of("instrument"), 0),
        ("Slope", lambda row: row["axis"].upper(), None),
        ("Days", _of("days"), 0),
        ("A \u2212 B now, deg", _of("level_deg"), 3),
        ("Drift, deg/year", _of("deg_per_year"), 2),
        ("\u00b1 (k = 2)", _of("deg_per_year_error", 2), 2),
        ("Band, deg", _of("band_deg"), 3),
        ("Leaves it on", _leaves, None),
    ]
    moving = First.of(row for row in rows if row["outside"] or row["significant"])
    text = ["A line through the daily means of A \u2212 B. A drift is listed where chance gives "
            "such a one in fewer than one of 10 000 lines, or the difference is outside its band."]
    if not moving.count:
        text = ["No machine has a difference that drifts or is outside its band."]
    charts = _drawn(figures, moving.rows)
    return _section("Drift of A \u2212 B", text, [_table("Drift", moving, columns)], charts)


def _leaves(row: Row) -> str | None:
    if row["outside"]:
        return "outside"
    if row["leaves_on"] is None:
        return None
    return f"{row['leaves_on']} ({row['leaves_earliest']} to {row['leaves_latest'] or 'never'})"


MEANS = """select date_diff('day', (select min(date) from machine_days), date) as t, date,
    difference_x_mean as x, difference_y_mean as y from machine_days
    where machine = $machine and interface = $interface and instrument = $instrument
    order by date"""


def _drawn(figures: Figures, moving: list[Row]) -> list[Row]:
    """The first of them over time, all in one chart's manner."""
    keys = ("machine", "interface", "instrument")
    charts = []
    for row in moving[:DRAWN]:
        own = list(figures.rows(MEANS, **{key: row[key] for key in keys}))
        series = {
            "name": "daily mean of A \u2212 B",
            "kind": "markers",
            "points": [[point["t"], point[row["axis"]]] for point in own],
        }
        limits = [row["band_deg"], -row["band_deg"]] if row["band_deg"] else []
        charts.append(
            {
                "title": f"{row['machine']}, slope {row['axis'].upper()}",
                "description": "Daily means of the difference of the channels, and its band.",
                "x_label": "day",
                "y_label": "deg",
                "series": [series],
                "levels": [{"at": at, "name": "band"} for at in limits],
                "x_names": _names(own),
            }
        )
    return charts


def _names(points: list[Row]) -> list[list[Any]]:
    """Names of a few days."""
    step = max(1, len(points) // 5)
    return [[point["t"], point["date"].isoformat()[5:]] for point in points[::step]]


SPANS = """select machine, instrument,
    min(temperature_min_degc) as temperature_min_degc,
    max(temperature_max_degc) as temperature_max_degc,
    avg(vibration_middle) as vibration_middle, max(vibration_max) as vibration_max
    from ({histories}) group by machine, interface, instrument
    order by vibration_max desc nulls last, machine, interface, instrument"""


def _histories(figures: Figures, rules: Rules) -> Row:
    text = SPANS.format(histories=sql("histories"))
    spans = First.of(figures.rows(text, **rules.parameters()))
    columns: list[Column] = [
        ("Machine", _of("machine"), None),
        ("Instrument", _of("instrument"), 0),
        ("Temperature from, degC", _of("temperature_min_degc"), 0),
        ("to, degC", _of("temperature_max_degc"), 0),
        ("Vibration, mean of days", _of("vibration_middle"), 1),
        ("greatest", _of("vibration_max"), 1),
    ]
    note = "Vibration is the energy above 150 Hz, in multiples of the channel's own noise."
    table = _table("The most vibration first", spans, columns, note)
    return _section("Temperature and vibration", [], [table], _over_days(figures))


SPREAD = """select date_diff('day', min(date) over (), date) as t, date,
    min(temperature_min_degc) as temperature_least,
    max(temperature_max_degc) as temperature_most,
    min(vibration_middle) as vibration_least,
    max(vibration_max) as vibration_most
    from machine_days group by date order by date"""


def _over_days(figures: Figures) -> list[Row]:
    """Temperature and vibration of the whole fleet, day by day."""
    days = list(figures.rows(SPREAD))
    charts = []
    for name, unit in [("temperature", "degC"), ("vibration", "times the own noise")]:
        keys = ("t", f"{name}_least", f"{name}_most")
        points = [[day[key] for key in keys] for day in days]
        title = f"{name.capitalize()} of the fleet"
        charts.append(
            {
                "title": title,
                "description": f"{title}: least and greatest of all machines, day by day.",
                "x_label": "day",
                "y_label": unit,
                "series": [{"name": "all machines", "kind": "band", "points": points}],
                "x_names": _names(days),
            }
        )
    return charts


def _calibration(figures: Figures, rows: Iterable[Row]) -> Row:
    columns: list[Column] = [
        ("Machine", _of("machine"), None),
        ("Due", _of("due"), None),
        ("Overdue", lambda row: "yes" if row["overdue"] else "no", None),
        ("Check sum", lambda row: "another" if row["other_calibration"] else "matches", None),
        ("Report", lambda row: "another" if row["other_report"] else "matches", None),
    ]
    first = First.of(rows)
    [known] = figures.rows("select count(*) as n from machines")
    if first.count:
        text = ["Overdue, or not the calibration of the certificate in the manifest."]
    elif known["n"]:
        text = ["No calibration is overdue, and none is another than the manifest has."]
    else:
        text = ["No manifest states when the calibrations are due, or their certificates."]
    return _section("Calibration", text, [_table("To be calibrated", first, columns)])


def _restarts(restarts: Iterable[Row], silent: Iterable[Row]) -> Row:
    columns: list[Column] = [
        ("Machine", _of("machine"), None),
        ("Restarts", _of("restarts"), 0),
        ("Of late", lambda row: row["recent_restarts"] or 0, 0),
        ("Days", _of("days_with_restarts"), 0),
        ("Last", _of("last_restart"), None),
    ]
    others: list[Column] = [
        ("Machine", _of("machine"), None),
        ("First day", _of("first_day"), None),
        ("Last day", _of("last_day"), None),
        ("Days without data", _of("silent_days"), 0),
        ("Of them until today", _of("silent_now"), 0),
    ]
    # One question after the other: the second is asked when all rows of the first are taken.
    tables = [
        _table("Nodes that restarted", First.of(restarts), columns),
        _table("Days without data", First.of(silent), others),
    ]
    is_any = any(table["rows"] for table in tables)
    text = [] if is_any else ["No node restarted, and no machine has a day without data."]
    return _section("Restarts and silent days", text, tables)


def _logs(told: Told) -> Row:
    listed = [
        {"log": one.log, "status": one.status, "sentence": one.sentence} for one in told.listed
    ]
    columns: list[Column] = [
        ("Log", _of("log"), None),
        ("Status", _of("status"), None),
        ("Why", _of("sentence"), None),
    ]
    text = [] if listed else ["Every log was read, and each of them once."]
    table = _table("Logs", First(listed, told.noted), columns)
    return _section("Logs that are not as they should be", text, [table])
