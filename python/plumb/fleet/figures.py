"""The figures of a machine's day as rows of a table: one for each instrument.

In: the JSON of `plumb report` of the day (docs/period-report.md). Out: a row with the columns of
`COLUMNS`, angles in degrees, times in s, temperatures in degC. What is not known is null.

Left out: single events and series over time, which are in the summary.
"""

from __future__ import annotations

import json
from typing import Any

import pyarrow

FAULTS = ("disagreement", "channel", "sensor", "safety", "heartbeat")
"""Kinds of events that count as faults: what a fault of `plumb report` is, without the bus."""

KINDS = ("warning", *FAULTS, "range", "memory", "bus", "foreign", "restart")
"""All kinds of events."""

_TEXT, _COUNT, _NUMBER = pyarrow.string(), pyarrow.int64(), pyarrow.float64()

_OF_CHANNEL = {
    "node_id": _COUNT,
    "vendor_id": _COUNT,
    "product_code": _COUNT,
    "revision": _COUNT,
    "serial_number": _COUNT,
    "software": _TEXT,
    "calibration_crc32": _TEXT,
    "report_sha256": _TEXT,
    "usable_s": _NUMBER,
    "unusable_s": _NUMBER,
    "boots": _COUNT,
    "heartbeat_losses": _COUNT,
    "heartbeat_lost_s": _NUMBER,
}

_QUANTITIES = ("uncertainty_deg", "temperature_degc", "activity")

_OF_AXIS = {"count": _COUNT, "mean": _NUMBER, "std": _NUMBER, "min": _NUMBER, "max": _NUMBER}


def _columns() -> dict[str, pyarrow.DataType]:
    columns = {"machine": _TEXT, "day": _TEXT, "interface": _TEXT, "instrument": _COUNT}
    columns |= {"from_s": _NUMBER, "to_s": _NUMBER, "covered_s": _NUMBER, "incidents": _COUNT}
    columns |= {f"{kind}_count": _COUNT for kind in KINDS}
    columns |= {"fault_count": _COUNT, "standing": _COUNT, "standing_text": _TEXT}
    for axis in "xy":
        columns |= {f"difference_{axis}_{name}": kind for name, kind in _OF_AXIS.items()}
    columns |= {"difference_judged": _COUNT, "difference_above": _COUNT}
    for side in "ab":
        columns |= {f"{side}_{name}": kind for name, kind in _OF_CHANNEL.items()}
        for quantity in _QUANTITIES:
            columns |= {f"{side}_{quantity}_{name}": _NUMBER for name in ("min", "mean", "max")}
    return columns


COLUMNS: dict[str, pyarrow.DataType] = _columns()
"""Each column of a row with its type."""

SCHEMA = pyarrow.schema(list(COLUMNS.items()))
"""The same as Arrow has it."""


def rows(machine: str, day: str, report: bytes) -> list[dict[str, Any]]:
    """The rows of a machine's day; one without figures where no instrument was seen."""
    found = json.loads(report)["instruments"]
    head = {"machine": machine, "day": day}
    empty = dict.fromkeys(COLUMNS)
    if not found:
        return [empty | head | {"instrument": 0, "covered_s": 0.0}]
    return [empty | head | _row(instrument) for instrument in found]


def _row(instrument: dict[str, Any]) -> dict[str, Any]:
    row = {
        "interface": instrument["interface"],
        "instrument": instrument["number"],
        "from_s": instrument["from_s"],
        "to_s": instrument["to_s"],
        "covered_s": instrument["covered_s"],
        "incidents": sum(day["incidents"] for day in instrument["days"]),
    }
    row |= _events(instrument)
    row |= _difference(instrument["difference"])
    for side, channel in zip("ab", instrument["channels"]):
        row |= _channel(side, channel)
    return row


def _events(instrument: dict[str, Any]) -> dict[str, Any]:
    counts = dict.fromkeys(KINDS, 0)
    for day in instrument["days"]:
        for kind in day["kinds"]:
            counts[kind["kind"]] += kind["count"]
    events = instrument["events"]
    open_ones = [one for one in events if one["kind"] in FAULTS and one["end"] == "standing"]
    texts = sorted({f"{one['channel']}: {_words(one)}" for one in open_ones})
    row: dict[str, Any] = {f"{kind}_count": count for kind, count in counts.items()}
    row["fault_count"] = sum(counts[kind] for kind in FAULTS)
    row["standing"] = len(open_ones)
    row["standing_text"] = "; ".join(texts) or None
    return row


def _words(event: dict[str, Any]) -> str:
    return f"{event['text']} ({event['code']})" if event["code"] else event["text"]


def _difference(difference: dict[str, Any]) -> dict[str, Any]:
    row = {
        "difference_judged": difference["judged"],
        "difference_above": difference["above"],
    }
    for axis in difference["slopes"]:
        for name in _OF_AXIS:
            value = axis["count"] if name == "count" else axis[f"{name}_deg"]
            row[f"difference_{axis['axis']}_{name}"] = value
    return row


def _channel(side: str, channel: dict[str, Any]) -> dict[str, Any]:
    row = {f"{side}_{name}": channel.get(name) for name in _OF_CHANNEL}
    row[f"{side}_unusable_s"] = sum(why["time_s"] for why in channel["unusable"])
    for quantity in _QUANTITIES:
        values = channel[quantity.partition("_")[0]]
        for name in ("min", "mean", "max"):
            row[f"{side}_{quantity}_{name}"] = values[name]
    return row
