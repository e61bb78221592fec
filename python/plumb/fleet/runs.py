"""A run over a fleet: logs to summaries, to the days of the machines, to tables and a page.

In: where the logs are, and the folder that the results go to. Out: an `Outcome`. Results are kept
by the content of the log, so that what is finished is not done again; the same logs give the same
bytes with any number of workers.

No list of all logs is in memory: what is known of each while the run lasts is in a `Scratch`.

Left out: each step (`layout`, `work`, `filing`, `merging`, `store`, `page`).
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import pathlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import pyarrow

from .._plumb import Error
from ..logs import node_ids, path_of, paths
from . import filing, layout, page, schedulers, scratch, work
from .errors import FleetError, first_line
from .merging import Progress, merge
from .scratch import Scratch
from .store import Line, Store, owned, refuse_others, rename_former_days
from .visits import Rules, refuse_other_rules

MOST_WORKERS = 64
"""The most processes that are started on one machine with fewer processors."""

LOST = work.Read(
    None, False, error=f"{work.HERE} is gone, and its summary is damaged: it no longer counts"
)
"""What is left of such a log."""

OTHERWISE = (
    f"{work.HERE} is gone, and was read with other --nodes or --eds: it no longer counts"
)
"""The sentence on such a log."""


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
    eds: str | Iterable[str] | None = None,
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
    with _in_fleet_errors(), scratch.opened() as known:
        logs, folder = path_of(logs, "logs"), _folder(path_of(out, "out"))
        manifest = None if manifest is None else path_of(manifest, "manifest")
        sheets = [] if eds is None else paths(eds)
        how = work.How(_pairs(nodes), tuple(os.path.abspath(sheet) for sheet in sheets))
        _refuse(pattern, workers, rules, progress)
        _find(known, logs, pattern, manifest, folder)
        refuse_others(folder)
        try:
            store = Store(folder, how.key)
        except OSError as why:
            raise FleetError(f"{why.filename} can't be read: {why.strerror}") from None
        work.refuse(how)
        with owned(folder):
            rename_former_days(folder)
            _recall(known, store, how)
            with schedulers.opened(scheduler, _workers(workers, known)) as place:
                read = _count(place, known, how, store, progress)
            known.add_known_machines(store.machines())
            store.write_machines(known.machines())
            store.write_ledger(known.ledger())
            store.end_journal()
            made = _page(known, store, how, rules, progress)
        return _outcome(made, known, read)


@contextlib.contextmanager
def _in_fleet_errors() -> Iterator[None]:
    """Errors of the package, and of the file system, as those of a fleet."""
    try:
        yield
    except FleetError:
        raise
    except Error as why:
        raise FleetError(str(why)) from None
    except OSError as why:
        place = f"{why.filename} " if why.filename else "a file "
        raise FleetError(
            f"{place}can't be used: {why.strerror or first_line(why)}; allow it or make room, and "
            "run again"
        ) from None


def _refuse(pattern: object, workers: object, rules: object, progress: object) -> None:
    """Refuses words of other types.

    Errors: `FleetError`.
    """
    if not isinstance(pattern, str):
        raise FleetError(f"pattern is {pattern!r}: give a text such as {layout.PATTERN!r}")
    if not (workers is None or isinstance(workers, int)):
        raise FleetError(f"workers is {workers!r}: give a whole number")
    refuse_other_rules(rules)
    if not callable(progress):
        raise FleetError(f"progress is {progress!r}: give a function")


def _folder(out: str) -> pathlib.Path:
    """The folder of the results.

    Errors: `FleetError` where it is a URL, or where its name can be in no table.
    """
    if "://" in out:
        raise FleetError(
            f"{out} is a URL, and results are written to a folder of this machine: name "
            "one, and copy it afterwards"
        )
    path = os.path.abspath(out)
    if layout.shown(path) != path:
        raise FleetError(f"{layout.shown(path)} is not UTF-8: give the results a folder that is")
    return pathlib.Path(out)


def _recall(known: Scratch, store: Store, how: work.How) -> None:
    """Enters what earlier runs have done: logs that are finished, and those that are gone."""
    known.add_before(store.ledger())
    for line in store.journal():
        known.add_known(line)
    for log, blake3 in known.logs(how.key):
        read = store.get(blake3)
        if read is None:
            known.add_todo(log)
        else:
            known.add_entry(filing.Entry(log, read))
    # Lines are taken while entries are added, which are in another table.
    for line, sentence in known.gone():
        known.add_entry(filing.left_over(line, _kept(store, line, how), sentence))


def _kept(store: Store, line: Line, how: work.How) -> work.Read:
    """What a log that is gone has come to.

    It has its content also where it no longer counts: another log may have the same one.
    """
    if read := store.get(line.blake3):
        return read
    if line.key == how.key:
        return dataclasses.replace(LOST, blake3=line.blake3)
    read = store.get(line.blake3, line.key) or LOST
    return dataclasses.replace(read, blake3=line.blake3, error=OTHERWISE, incomplete=None)


def _count(
    place: schedulers.Place, known: Scratch, how: work.How, store: Store, progress: Progress
) -> int:
    """Reads what has to be read, files all, and merges the days; how many logs were read.

    A summary of an earlier run that turns out to be damaged is made again.
    """
    count = _read(place, known, how, store, progress)
    _look_into(place, known, store)
    _file(known, how)
    if merge(place, known, how.key, store, progress) is None:
        return count
    known.read_damaged_again(LOST)
    count += _read(place, known, how, store, progress)
    _look_into(place, known, store)
    _file(known, how)
    if damage := merge(place, known, how.key, store, progress):
        raise FleetError(damage)
    return count


def _page(
    known: Scratch, store: Store, how: work.How, rules: Rules, progress: Progress
) -> page.Made:
    """The page; a day whose tables are damaged is merged again before."""
    try:
        return page.write(store, rules, known.told(page.ROWS))
    except (FleetError, OSError, pyarrow.ArrowException):
        if not store.drop_damaged():
            raise
    if damage := merge(schedulers.Here(), known, how.key, store, progress):
        raise FleetError(damage)
    return page.write(store, rules, known.told(page.ROWS))


def _pairs(nodes: Iterable[int]) -> tuple[int, ...]:
    """The nodes of the instruments, A, B, A, B.

    Errors: `Error` where one is no node-id, or has no partner.
    """
    given = tuple(node_ids(nodes))
    if len(given) % 2:
        raise FleetError("each instrument has two nodes, A and B: write them as 1,2")
    return given


def _find(
    known: Scratch,
    logs: str | os.PathLike[str],
    pattern: str,
    manifest: str | os.PathLike[str] | None,
    out: pathlib.Path,
) -> None:
    """Enters all logs that there are.

    Errors: `FleetError` where there is none.
    """
    found = layout.find(logs, pattern, out) if manifest is None else layout.read_manifest(manifest, logs)
    for one in found:
        known.add(one)
    # The results may stand below the logs.
    known.leave_out([f"{out.resolve()}{os.sep}", f"{os.path.abspath(out)}{os.sep}"])
    if known.has_logs():
        return
    count, first = known.strays()
    if first is not None:
        raise FleetError(
            f"there is no log to count, of {count} files: {first.url}: {first.sentence}"
        )
    raise FleetError(f"{logs} holds no log but results: name the folder of the machines")


def _workers(wanted: int | None, known: Scratch) -> int:
    if wanted is not None:
        if wanted < 1:
            raise FleetError(f"{wanted} workers can't work: give one or more")
        if wanted > (most := max(MOST_WORKERS, os.cpu_count() or 1)):
            raise FleetError(f"{wanted} workers are more than one machine takes: give at most {most}")
        return wanted
    _, size = known.todo_size()
    return max(1, min(os.cpu_count() or 1, size // schedulers.GROUP_BYTES))


def _read(
    place: schedulers.Place, known: Scratch, how: work.How, store: Store, progress: Progress
) -> int:
    """Reads the logs that have to be read; how many. Each result is kept at once."""
    (count, total), read, done = known.todo_size(), 0, 0
    progress("reading", 0, count, 0, total)
    jobs = ((log, log.size) for log in known.todo())
    for group, outcome in place.map(work.read_all, jobs, how):
        if isinstance(outcome, Exception):
            sentence = f"{work.HERE} can't be read: {outcome}"
            outcome = [work.Read(None, False, error=sentence) for log in group]
        for log, found in zip(group, outcome):
            result = store.put(found)
            store.note(log, result, how.key)
            known.add_entry(filing.Entry(log, _or_earlier(known, store, how, log, result)))
        read += len(group)
        done += sum(log.size for log in group)
        progress("reading", read, count, done, total)
    known.end_todo()
    return read


def _or_earlier(
    known: Scratch, store: Store, how: work.How, log: layout.Log, result: work.Read
) -> work.Read:
    """What a log has come to; where its file can't be read, what it had come to before."""
    line = known.earlier(log) if result.blake3 is None else None
    before = None if line is None else _kept(store, line, how)
    if before is None or before.error is not None or result.error is None:
        return result
    return filing.in_force(before, result.error)


def _look_into(place: schedulers.Place, known: Scratch, store: Store) -> None:
    """Finds which files have the same content, since one is the other one compressed.

    What could not be looked into counts for itself and is listed; the next run looks into it.
    """
    known.add_alike()
    jobs = ((one, one[0].size) for one in known.alike())
    for group, outcome in place.map(work.contents, jobs):
        if isinstance(outcome, Exception):
            outcome = [work.Content(None, work.not_compared(str(outcome)))] * len(group)
        for (_, blake3), content in zip(group, outcome):
            if content.error is not None:
                known.add_incomplete(blake3, content.error)
            elif content.blake3 is not None:
                known.add_content(blake3, content.blake3)
                store.put_content(blake3, content.blake3)
    known.end_todo()


def _file(known: Scratch, how: work.How) -> None:
    """Enters the line of each log, and which of them each day consists of.

    Errors: `FleetError` where none counts.
    """
    known.clear_lines()
    for entry, note in known.entries():
        line, part = filing.filed(entry, note, known.twin(entry.read), how.key)
        if entry.gone and part is not None and (other := known.successor(entry)):
            line, part = filing.replaced(entry, other, how.key), None
        if line is not None:
            known.add_line(line)
        if part is not None:
            known.add_part(part, entry)
    known.add_stray_lines(how.key)
    if known.machine_count() == 0:
        raise _nothing(known)


def _nothing(known: Scratch) -> FleetError:
    failed = known.told(1)
    others = f", and {failed.bad - 1} more" if failed.bad > 1 else ""
    first = failed.listed[0]
    sentence = first.sentence or ""
    where = "" if first.log in sentence else f"{first.log}: "
    return FleetError(f"no log could be counted: {where}{sentence}{others}")


def _outcome(made: page.Made, known: Scratch, read: int) -> Outcome:
    def of(*statuses: str) -> dict[str, str]:
        return {line.log: line.sentence or "" for line in known.lines(*statuses)}

    told = known.told(0)
    return Outcome(
        page=made.path,
        verdict=made.verdict,
        machines=known.machine_count(),
        logs=told.counted,
        frames=told.frames,
        read=read,
        skipped=known.entry_count() - read,
        failed=of("failed"),
        incomplete=of("incomplete"),
        notes=of("counted", "duplicate", "stray"),
        visits=made.visits,
    )
