"""Output of a headless run: narration on stderr, and the same as JSON lines on stdout where that is requested."""

import os
import sys
from collections.abc import Callable, Iterable

import msgspec

from gloc3.cli.narration import narrate
from gloc3.clock import utc_now
from gloc3.errors import Finding
from gloc3_groundstation.reporting.lines import EndLine, NarrationLine, utc_time
from gloc3_groundstation.reporting.outcomes import RunOutcome

Data = Callable[[NarrationLine], None]


class RunOutput:
    """Writes the lines of a run.

    Args:
        data: called with each line for programs; None for none.
    """

    def __init__(self, data: Data | None = None) -> None:
        self._data = data
        self._last_s = 0.0

    def line(self, line: NarrationLine) -> None:
        """Writes a line for people, and for programs."""
        narrate(str(line))
        self._send(line)

    def findings(self, findings: Iterable[Finding]) -> None:
        """Writes what a check has found, for programs; people read the error that it is part of."""
        for finding in findings:
            self._send(self._own("finding", str(finding), finding))

    def end(self, outcome: RunOutcome, text: str = "") -> None:
        """Writes the last line, for programs; people read what led to it."""
        self._send(
            EndLine(
                utc=utc_time(utc_now().timestamp()),
                t_s=self._last_s,
                platform="",
                kind="end",
                text=text or outcome.replace("_", " "),
                outcome=outcome,
                exit_code=outcome.exit_code,
            )
        )

    def _own(self, kind: str, text: str, data: msgspec.Struct) -> NarrationLine:
        now = utc_time(utc_now().timestamp())
        return NarrationLine(utc=now, t_s=self._last_s, platform="", kind=kind, text=text, data=data)

    def _send(self, line: NarrationLine) -> None:
        self._last_s = line.t_s
        if self._data is not None:
            self._data(line)


def print_json(line: NarrationLine) -> None:
    """Prints a line on stdout; a reader that has gone does not end the run."""
    try:
        sys.stdout.write(msgspec.json.encode(line).decode() + "\n")
        sys.stdout.flush()
    except BrokenPipeError:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())
        os.close(null)
