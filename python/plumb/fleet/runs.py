"""A run over a fleet: logs to summaries, to the days of the machines, to tables and a page.

In: where the logs are, and the folder that the results go to. Out: an `Outcome`. Results are kept
by the content of the log, so that what is finished is not done again; the same logs give the same
bytes with any number of workers.

Left out: each step (`layout`, `work`, `filing`, `store`, `page`).
"""

from __future__ import annotations

import hashlib
import json
import os
import pathlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from .._plumb import Error
from ..logs import node_ids
from . import filing, layout, page, schedulers, work
from .errors import FleetError
from .figures import SCHEMA
from .store import SUMMARIES, Line, Store, owned, refuse_other_kinds, write_table
from .visits import Rules

Progress = Callable[[str, int, int, float, float], None]
"""Called with the stage, the jobs that are done and all of them, and the same of the work."""

MERGE_BYTES = 1 << 16
"""What a merge counts for in a group of jobs, besides its summaries, which count four times: they
are sent with it."""

UNPACKED = 16
"""Summaries that are written at once."""

LOST = work.Read(
    None, False, error=f"{work.HERE} is gone, and its summary is damaged: it no longer counts"
)
"""What is left of such a log."""


@dataclass(frozen=True)
class Outcome:
    """What a run has done."""

    page: pathlib.Path
    """report.html."""
    verdict: str
    """The fleet in one sentence."""
    machines: int
    logs: int
    """Logs that count."""
    frames: int
    read: int
    """Logs that were read in this run; the others were finished."""
    skipped: int
    """Logs that were finished before."""
    failed: dict[str, str]
    """Logs that could not be counted, each with its sentence."""
    incomplete: dict[str, str]
    """Logs of which a part could not be read; the rest counts."""
    notes: dict[str, str]
    """Logs that are duplicates, of another day than their path, of no machine, or listed twice."""
    visits: list[str]
    """Machines that need a visit, the most urgent first."""


def run(
    logs: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    pattern: str = layout.PATTERN,
    manifest: str | os.PathLike[str] | None = None,
    scheduler: str | schedulers.Place | None = None,
    workers: int | None = None,
    nodes: Iterable[int] = (),
    eds: Iterable[str] = (),
    rules: Rules = Rules(),
    progress: Progress = lambda *_: None,
) -> Outcome:
    """Counts the logs of a fleet into the folder `out`; what is finished there is not done again.

    `logs` is a folder or an fsspec URL, `pattern` is the form of the paths below it,
    or `manifest` is a Parquet table of them. `scheduler` is the address of a Dask scheduler, or
    what has a `map` as `schedulers.Place`; without one `workers` processes of this machine are
    used, by default one for each processor.
    Errors: `FleetError` with one sentence; what was there before is still there.
    """
    folder = pathlib.Path(out)
    how = work.How(_pairs(nodes), tuple(os.path.abspath(sheet) for sheet in eds))
    found = _found(logs, pattern, manifest, folder)
    refuse_other_kinds(folder)
    try:
        store = Store(folder, how.key)
    except OSError as why:
        raise FleetError(f"{why.filename} can't be read: {why.strerror}") from None
    with owned(folder):
        plan = _plan(found, store, how)
        with schedulers.opened(scheduler, _workers(workers, plan.todo)) as place:
            filed = _file(place, plan, how, store, progress)
            # A line and its content are all that is held of a log while days are merged.
            del plan
            found.logs.clear()
            _refuse_nothing(filed)
            _merge(place, filed.days, store, progress)
        machines = store.machines() | found.machines
        store.write_machines(machines)
        store.write_ledger(filed.lines)
        store.end_journal()
        made = page.write(store, rules, filed.lines)
    return _outcome(made, filed)


@dataclass(frozen=True)
class Plan:
    """What a run has to do."""

    todo: list[layout.Log]
    """Logs that have to be read."""
    entries: list[filing.Entry]
    """Those that are finished, and those that are gone."""
    strays: dict[str, str]
    """Files of no machine, each with a sentence."""
    notes: dict[str, str]
    """Logs that count, and of which something is to be said."""


@dataclass(frozen=True)
class Filed:
    """What the logs have come to, and where it counts."""

    lines: list[Line]
    days: dict[str, dict[str, filing.Parts]]
    read: int
    """Logs that were read."""
    entries: int
    """Logs in all."""


def _plan(found: layout.Found, store: Store, how: work.How) -> Plan:
    ledger = store.ledger()
    todo, entries = _finished(found, ledger | store.journal(), store, how)
    return Plan(todo, entries + _gone(found, ledger, store, how), found.strays, found.notes)


def _file(place: Any, plan: Plan, how: work.How, store: Store, progress: Progress) -> Filed:
    """Reads what has to be read, and files all; what was kept and is damaged is read again."""
    entries, read = plan.entries, len(plan.todo)
    known = {entry.read.blake3 for entry in entries}
    entries = entries + _read(place, plan.todo, how, store, progress)
    lines, days = filing.file(entries, plan.strays, plan.notes, how.key)
    if damaged := _damaged(days, known, store):
        again, entries = _apart(entries, damaged)
        entries += _read(place, again, how, store, progress)
        lines, days = filing.file(entries, plan.strays, plan.notes, how.key)
        read += len(again)
    return Filed(lines, days, read, len(entries))


def _pairs(nodes: Iterable[int]) -> tuple[int, ...]:
    """The nodes of the instruments, A, B, A, B.

    Errors: `FleetError` where one is no node-id, or has no partner.
    """
    try:
        given = tuple(node_ids(nodes))
    except Error as why:
        raise FleetError(str(why)) from None
    if len(given) % 2:
        raise FleetError("each instrument has two nodes, A and B: write them as 1,2")
    return given


def _found(
    logs: str | os.PathLike[str],
    pattern: str,
    manifest: str | os.PathLike[str] | None,
    out: pathlib.Path,
) -> layout.Found:
    found = layout.find(logs, pattern) if manifest is None else layout.read_manifest(manifest, logs)
    # The results may stand below the logs.
    own = (f"{out.resolve()}{os.sep}", f"{os.path.abspath(out)}{os.sep}")
    found.logs = [log for log in found.logs if not (log.local and log.url.startswith(own))]
    found.strays = {url: why for url, why in found.strays.items() if not url.startswith(own)}
    if not found.logs and found.strays:
        url, why = min(found.strays.items())
        raise FleetError(f"there is no log to count, of {len(found.strays)} files: {url}: {why}")
    if not found.logs:
        raise FleetError(f"{logs} holds no log but results: name the folder of the machines")
    return found


def _workers(wanted: int | None, todo: list[layout.Log]) -> int:
    if wanted is not None:
        if wanted < 1:
            raise FleetError(f"{wanted} workers can't work: give one or more")
        return wanted
    work_groups = sum(log.size for log in todo) // schedulers.GROUP_BYTES
    return max(1, min(os.cpu_count() or 1, work_groups))


def _finished(
    found: layout.Found, ledger: dict[str, Line], store: Store, how: work.How
) -> tuple[list[layout.Log], list[filing.Entry]]:
    """The logs that have to be read, and those that are finished."""
    todo, entries = [], []
    for log in found.logs:
        known = None
        if log.stamp != "" and (line := ledger.get(log.url)):
            same = (line.stamp, line.size, line.key) == (log.stamp, log.size, how.key)
            known = store.get(line.blake3) if same else None
        if known is None:
            todo.append(log)
        else:
            entries.append(filing.Entry(log, known))
    return todo, entries


def _gone(
    found: layout.Found, ledger: dict[str, Line], store: Store, how: work.How
) -> list[filing.Entry]:
    """Logs of earlier runs that are no longer there, and were counted."""
    there = {log.url for log in found.logs} | set(found.strays)
    entries = []
    for url, line in ledger.items():
        if url in there or line.day is None or line.key != how.key:
            continue
        entries.append(filing.left_over(line, store.get(line.blake3) or LOST))
    return entries


def _damaged(days: dict, known: set[str | None], store: Store) -> set[str]:
    """Contents of earlier runs of which a day needs the summary, and it is damaged."""
    needed = {
        blake3
        for day in _changed(days, store)
        for parts in days[day].values()
        for blake3, _ in parts
    }
    return {blake3 for blake3 in needed & known if not store.is_whole(blake3)}


def _apart(
    entries: list[filing.Entry], damaged: set[str]
) -> tuple[list[layout.Log], list[filing.Entry]]:
    """The logs of damaged summaries that have to be read again, and all others; those that are gone
    without another log of their content are lost."""
    again = [one for one in entries if one.read.blake3 in damaged and not one.gone]
    lost = damaged - {one.read.blake3 for one in again}
    others = [one for one in entries if one.read.blake3 not in damaged or one.gone]
    others = [replace(one, read=LOST) if one.read.blake3 in lost else one for one in others]
    return [one.log for one in again], others


def _read(
    place: Any, todo: list[layout.Log], how: work.How, store: Store, progress: Progress
) -> list[filing.Entry]:
    """What each log comes to; each result is kept at once."""
    results: list[filing.Entry] = []
    total, done = sum(log.size for log in todo), 0
    progress("reading", 0, len(todo), 0, total)
    jobs = ((log, log.size) for log in todo)
    for group, outcome in place.map(work.read_all, jobs, how):
        if isinstance(outcome, Exception):
            sentence = f"{work.HERE} can't be read: {outcome}"
            outcome = [work.Read(None, False, error=sentence) for log in group]
        for log, result in zip(group, outcome):
            store.put(result)
            store.note(log, result, how.key)
            results.append(filing.Entry(log, filing.without_summary(result)))
        done += sum(log.size for log in group)
        progress("reading", len(results), len(todo), done, total)
    return results


def _refuse_nothing(filed: Filed) -> None:
    if filed.days:
        return
    failed = [line.sentence for line in filed.lines if line.status == "failed"]
    others = f", and {len(failed) - 1} more" if len(failed) > 1 else ""
    raise FleetError(f"no log could be counted: {failed[0]}{others}")


def _merge(place: Any, days: dict, store: Store, progress: Progress) -> None:
    """Writes each day whose logs are others than before."""
    for day in set(store.days()) - set(days):
        store.drop_day(day)
    changed = _changed(days, store)
    all_jobs = sum(len(days[day]) for day in changed)
    waiting: dict[str, list[work.Counted]] = {day: [] for day in changed}
    jobs = _days(changed, days, store)
    done = 0
    for group, outcome in place.map(work.join, jobs):
        if isinstance(outcome, Exception):
            raise outcome
        for counted in outcome:
            waiting[counted.day].append(counted)
            if len(waiting[counted.day]) == len(days[counted.day]):
                digest = _digest(days[counted.day])
                _write_day(store, counted.day, waiting.pop(counted.day), digest)
        done += len(group)
        progress("merging", done, all_jobs, done, all_jobs)


def _changed(days: dict, store: Store) -> list[str]:
    """The days that are not there, or of other logs."""
    return [day for day in sorted(days) if store.digest(day) != _digest(days[day])]


def _days(changed: list[str], days: dict, store: Store) -> Iterator[tuple[work.Day, int]]:
    for day in changed:
        for machine, parts in sorted(days[day].items()):
            packed = tuple((store.summary(blake3), name) for blake3, name in parts)
            size = sum(len(one) for one, _ in packed)
            yield work.Day(machine, day, packed), MERGE_BYTES * len(packed) + 4 * size


def _digest(machines: dict[str, filing.Parts]) -> str:
    known = [SCHEMA.to_string(), sorted(machines.items())]
    return hashlib.sha256(json.dumps(known).encode()).hexdigest()


def _write_day(store: Store, day: str, counted: list[work.Counted], digest: str) -> None:
    counted.sort(key=lambda one: one.machine)
    figures = (row for one in counted for row in one.rows)
    write_table(store.partition("figures", day), figures, SCHEMA, digest)
    summaries = (
        {"machine": one.machine, "day": day, "summary": work.unpack(one.summary)}
        for one in counted
    )
    write_table(store.partition("summaries", day), summaries, SUMMARIES, digest, UNPACKED)


def _outcome(made: page.Made, filed: Filed) -> Outcome:
    lines = filed.lines

    def of(*statuses: str) -> dict[str, str]:
        wanted = [line for line in lines if line.status in statuses and line.sentence]
        return {line.log: line.sentence for line in wanted}

    counted = [line for line in lines if line.status in ("counted", "incomplete")]
    return Outcome(
        page=made.path,
        verdict=made.verdict,
        machines=len({machine for machines in filed.days.values() for machine in machines}),
        logs=len(counted),
        frames=sum(line.frames for line in counted),
        read=filed.read,
        skipped=filed.entries - filed.read,
        failed=of("failed"),
        incomplete=of("incomplete"),
        notes=of("counted", "duplicate", "stray"),
        visits=made.visits,
    )
