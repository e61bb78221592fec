"""`python -m plumb.fleet LOGS OUT`: counts the logs of a fleet.

The exit status is 0 whatever the machines have done, and 2 where it can't be done, or, with the
page of all the rest, where a log can't be read or only in part.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from typing import TextIO

from .._plumb import Error
from .layout import PATTERN
from .progress import Bar
from .runs import Outcome, run
from .visits import Rules

LISTED = 20
"""Logs that the terminal lists; logs.parquet has them all."""


def parser() -> argparse.ArgumentParser:
    """The command line."""
    words = argparse.ArgumentParser(prog="python -m plumb.fleet", description=__doc__.split("\n")[0])
    words.add_argument("logs", metavar="LOGS", help="folder or URL of the logs")
    words.add_argument("out", metavar="OUT", help="folder for tables and page")
    words.add_argument("--pattern", default=PATTERN, help="paths of the logs (default: %(default)s)")
    words.add_argument("--manifest", help="Parquet table of the logs and machines")
    words.add_argument("--scheduler", help="address of a Dask scheduler, such as tcp://host:8786")
    words.add_argument("--workers", type=int, help="processes of this machine")
    words.add_argument("--nodes", default="", help="node-ids A,B,A,B of the instruments")
    words.add_argument("--eds", action="append", default=[], help="FILE@NODE: a node's data sheet")
    words.add_argument("--today", help="the day that all is seen from, such as 2026-11-20")
    words.add_argument("--band", type=float, help="half the band of A - B, deg")
    return words


def main(arguments: list[str] | None = None) -> int:
    """Does it; the exit status."""
    given = parser().parse_args(arguments)
    bar = Bar()
    try:
        with _terminated_as_interrupted():
            outcome = _run(given, bar)
    except Error as why:
        bar.close()
        _say(f"plumb.fleet: {why}", sys.stderr)
        return 2
    except KeyboardInterrupt:
        bar.close()
        _say("plumb.fleet: interrupted: what is finished is kept, run again", sys.stderr)
        return 130
    bar.close()
    try:
        _tell(outcome)
        sys.stdout.flush()
    except BrokenPipeError:
        # Python would write what is left when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as why:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        said = f"the output can't be written: {why.strerror}"
        _say(f"plumb.fleet: {said}; the results are in {outcome.page.parent}", sys.stderr)
        return 2
    return 2 if outcome.failed or outcome.incomplete else 0


def _run(given: argparse.Namespace, bar: Bar) -> Outcome:
    return run(
        given.logs,
        given.out,
        pattern=given.pattern,
        manifest=given.manifest,
        scheduler=given.scheduler,
        workers=given.workers,
        nodes=_nodes(given.nodes),
        eds=given.eds,
        rules=Rules(today=given.today, band_deg=given.band),
        progress=bar,
    )


@contextlib.contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """SIGTERM ends the run as Ctrl-C does: with the processes that it has started."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _nodes(text: str) -> list[int]:
    try:
        return [int(part) for part in text.split(",") if part.strip()]
    except ValueError:
        raise Error(f"--nodes {text} is no list of node-ids: write it as 1,2") from None


def _tell(outcome: Outcome) -> None:
    _say(outcome.verdict)
    _say(f"{outcome.logs} logs, {outcome.read} read now, {outcome.skipped} finished before")
    _list("Not counted", outcome.failed)
    _list("Counted in part", outcome.incomplete)
    _list("To be noted", outcome.notes)
    _say(f"Page: {outcome.page}")


def _list(title: str, sentences: dict[str, str]) -> None:
    if not sentences:
        return
    _say(f"{title}: {len(sentences)}")
    for log, sentence in list(sentences.items())[:LISTED]:
        _say(f"  {sentence}" if log in sentence else f"  {log}: {sentence}")
    if len(sentences) > LISTED:
        _say(f"  and {len(sentences) - LISTED} more, in logs.parquet")


def _say(text: str, out: TextIO | None = None) -> None:
    """A line of text, in the letters that the terminal has, and without what it might take for a
    command."""
    out = out or sys.stdout
    text = "".join(letter if letter.isprintable() else " " for letter in text)
    letters = getattr(out, "encoding", None) or "utf-8"
    print(text.encode(letters, "backslashreplace").decode(letters), file=out)


if __name__ == "__main__":
    sys.exit(main())
