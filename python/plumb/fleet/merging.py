"""The days of the machines: the summaries of the logs of each merged, and written where they are
others than before.

In: the parts of the days in a `Scratch`, and the summaries of the logs in a `Store`. Out: the
tables of each day. A machine's day is merged at a time, and one of many logs in several steps,
which is exact in any grouping; what is done waits in the `Scratch` until its day is complete.

Left out: which log counts on which day (`filing`), and the merge itself (`work`).
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Callable, Iterable, Iterator

import pyarrow

from . import work
from .figures import SCHEMA
from .filing import Part
from .schedulers import Function, Place
from .scratch import Scratch
from .store import SUMMARIES, Damaged, Store, write_table

Progress = Callable[[str, int, int, float, float], None]
"""Called with the stage, the jobs that are done and all of them, and the same of the work."""

MERGE_BYTES = 1 << 16
"""What a merge counts for in a group of jobs, besides its summaries, which count four times: they
are sent with it."""

PARTS = 64
"""Summaries that are merged at once. A machine's day of more logs is merged in several steps."""

UNPACKED = 16
"""Summaries that are written at once."""

Job = tuple[work.Day, int]
"""A merge, and what it counts for in a group."""


def merge(
    place: Place, scratch: Scratch, key: str, store: Store, progress: Progress
) -> str | None:
    """Writes each day whose logs are others than before, or were read otherwise, and removes days
    without a log. `key` stands for how the logs were read.

    Where summaries are damaged, their days are left as they are, and the contents are in `scratch`;
    the sentence on one of them is returned, and None where all was written.
    """
    digests = {day: digest(key, scratch.parts(day)) for day in scratch.days()}
    for day in set(store.days()) - set(digests):
        store.drop_day(day)
    changed = {day: own for day, own in digests.items() if store.digest(day) != own}
    merger = _Merger(scratch, store, changed)
    merger.fold(place, progress)
    merger.finish(place, progress)
    # Arrow keeps what the tables needed, and the page needs as much again.
    pyarrow.default_memory_pool().release_unused()
    return merger.damage


def digest(key: str, parts: Iterable[Part]) -> str:
    """Stands for all that a day is made of: the SHA-256 of the JSON of the columns, of how the logs
    were read, and of each machine with contents and names of its logs, which are in their order."""
    known = hashlib.sha256(f"[{json.dumps(SCHEMA.to_string())}, {json.dumps(key)}, [".encode())
    before = ""
    for machine, own in itertools.groupby(parts, key=lambda part: part.machine):
        texts = (json.dumps([part.blake3, part.name]) for part in own)
        known.update(f"{before}[{json.dumps(machine)}, [{next(texts)}".encode())
        for text in texts:
            known.update(f", {text}".encode())
        known.update(b"]]")
        before = ", "
    known.update(b"]]")
    return known.hexdigest()


def steps(logs: int) -> int:
    """Jobs that it takes to merge so many logs of a machine's day."""
    count = 1
    while logs > PARTS:
        logs = -(-logs // PARTS)
        count += logs
    return count


class _Merger:
    """The merge of the days that have changed."""

    def __init__(self, scratch: Scratch, store: Store, changed: dict[str, str]) -> None:
        self._scratch, self._store, self._changed = scratch, store, changed
        self._many: dict[tuple[str, str], int] = {}
        """Logs of each machine's day that is merged in several steps."""
        self._levels: dict[tuple[str, str], int] = {}
        """How often these were merged."""
        self._left = dict.fromkeys(changed, 0)
        """Machines of each day that are not yet merged."""
        self._done = self._jobs = 0
        self.damage: str | None = None
        """The sentence on a summary that is damaged."""
        for day in changed:
            for machine, logs in scratch.machines_of(day):
                self._left[day] += 1
                self._jobs += steps(logs)
                if logs > PARTS:
                    self._many[day, machine] = logs

    def fold(self, place: Place, progress: Progress) -> None:
        """Merges the logs of machines that have many on a day, until few summaries are left."""
        many, level = self._many, 0
        while many:
            jobs = (job for day, machine in many for job in self._some(day, machine, level))
            for counted in self._results(place, work.fold, jobs, progress):
                self._scratch.add_piece(counted, level + 1)
            level += 1
            self._levels |= dict.fromkeys(many, level)
            many = {key: -(-logs // PARTS) for key, logs in many.items() if logs > PARTS * PARTS}

    def finish(self, place: Place, progress: Progress) -> None:
        """Merges what is left of each machine's day, and writes the days that are complete."""
        jobs = (job for day in self._changed for job in self._last(day))
        for counted in self._results(place, work.join, jobs, progress):
            self._scratch.add_merged(counted)
            self._left[counted.day] -= 1
            if self._left[counted.day] == 0:
                self._write(counted.day)

    def _results(
        self, place: Place, function: Function, jobs: Iterator[Job], progress: Progress
    ) -> Iterator[work.Counted]:
        for group, outcome in place.map(function, jobs):
            if isinstance(outcome, Exception):
                raise outcome
            yield from outcome
            self._done += len(group)
            progress("merging", self._done, self._jobs, self._done, self._jobs)

    def _some(self, day: str, machine: str, level: int) -> Iterator[Job]:
        """Merges of `PARTS` summaries each."""
        summaries = self._summaries(day, machine, level)
        while parts := tuple(itertools.islice(summaries, PARTS)):
            yield _job(day, machine, parts)

    def _last(self, day: str) -> Iterator[Job]:
        """The last merge of each machine's day, without those that have a damaged summary."""
        for machine, logs in self._scratch.machines_of(day):
            level = self._levels.get((day, machine), 0)
            parts = tuple(self._summaries(day, machine, level))
            is_whole = self.damage is None if level else len(parts) == logs
            if is_whole:
                yield _job(day, machine, parts)

    def _summaries(self, day: str, machine: str, level: int) -> Iterator[work.Part]:
        """Those of the logs of a machine's day, or what these were merged to so many times."""
        if level:
            for summary in self._scratch.pieces(day, machine, level):
                yield summary, None
            return
        for part in self._scratch.parts(day, machine):
            try:
                yield self._store.summary(part.blake3), part.name
            except Damaged as why:
                self._scratch.add_damaged(part.blake3)
                self.damage = str(why)

    def _write(self, day: str) -> None:
        """Writes the tables of a day."""
        inputs, scratch = self._changed[day], self._scratch
        figures = self._store.partition("figures", day)
        write_table(figures, scratch.merged_rows(day), SCHEMA, inputs)
        summaries = (
            {"machine": machine, "day": day, "summary": work.unpack(packed)}
            for machine, packed in scratch.merged_summaries(day)
        )
        place = self._store.partition("summaries", day)
        write_table(place, summaries, SUMMARIES, inputs, UNPACKED)
        scratch.end_day(day)


def _job(day: str, machine: str, parts: tuple[work.Part, ...]) -> Job:
    size = sum(len(summary) for summary, _ in parts)
    return work.Day(machine, day, parts), MERGE_BYTES * len(parts) + 4 * size
