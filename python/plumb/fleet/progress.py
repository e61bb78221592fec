"""A progress bar with the time left, on a terminal.

In: how much of how much is done. Out: one line that is written over; nothing where the output is
no terminal.
"""

from __future__ import annotations

import sys
import time
from typing import TextIO

WIDTH = 30
"""Characters of the bar."""

EVERY_S = 0.1
"""Time between two lines."""


def left(done: float, total: float, since_s: float) -> str:
    """The time left in words, at the speed so far; nothing before there is one."""
    if done <= 0 or total <= 0:
        return ""
    seconds = round(since_s * max(total - done, 0) / done)
    minutes, seconds = divmod(seconds, 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02} min left"
    return f"{minutes} min {seconds:02} s left" if minutes else f"{seconds} s left"


class Bar:
    """The bar of one stage after the other."""

    def __init__(self, out: TextIO = sys.stderr) -> None:
        self._out = out
        self._shown = out.isatty()
        self._stage = ""
        self._since_s = self._last_s = 0.0

    def __call__(self, stage: str, jobs: int, all_jobs: int, done: float, total: float) -> None:
        """So many of all jobs are done, which is so much of the whole work."""
        now_s = time.monotonic()
        if stage != self._stage:
            self._stage, self._since_s, self._last_s = stage, now_s, 0.0
        if not self._shown or (now_s - self._last_s < EVERY_S and jobs < all_jobs):
            return
        self._last_s = now_s
        self._write("\r\x1b[K" + self.line(jobs, all_jobs, done, total, now_s - self._since_s))

    def line(self, jobs: int, all_jobs: int, done: float, total: float, since_s: float) -> str:
        """The line."""
        share = done / total if total else 1.0
        full = round(WIDTH * min(share, 1.0))
        bar = "#" * full + "-" * (WIDTH - full)
        text = f"{self._stage} [{bar}] {jobs} of {all_jobs}"
        rest = left(done, total, since_s)
        return f"{text}, {rest}" if rest and jobs < all_jobs else text

    def close(self) -> None:
        """Removes the line."""
        if self._shown and self._stage:
            self._write("\r\x1b[K")

    def _write(self, text: str) -> None:
        """Writes to the terminal; a run goes on without one."""
        try:
            self._out.write(text)
            self._out.flush()
        except OSError:
            self._shown = False
