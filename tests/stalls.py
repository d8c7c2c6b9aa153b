"""A test in wall time that fails is run once more, and up to twice more where the machine stood still meanwhile.

What flies by real sockets acts on silence within tenths of a second, and rightly so; a machine that is shared does not
always give it these. It is looked whether this process slept longer than it wanted to. What failed and then passed is
listed at the end of the run: nobody is to get used to it.
"""

import threading
import time

import pytest
from _pytest.runner import runtestprotocol

STALL_S = 0.5
ATTEMPTS = 3
RUN_AGAIN = "run again"
_NAP_S = 0.02


class Watch(threading.Thread):
    """Sleeps, and notes by how much it overslept."""

    def __init__(self) -> None:
        super().__init__(name="stall watch", daemon=True)
        self.longest_s = 0.0
        """Since somebody has set it back."""

    def run(self) -> None:
        """Goes on as long as the process."""
        while True:
            wanted_s = time.monotonic() + _NAP_S
            time.sleep(_NAP_S)
            self.longest_s = max(self.longest_s, time.monotonic() - wanted_s)


_watches: list[Watch] = []


def _watch() -> Watch:
    if not _watches:
        _watches.append(Watch())
        _watches[0].start()
    return _watches[0]


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Runs what is marked `sockets`, again where it fails."""
    if item.get_closest_marker("sockets") is None:
        return None
    watch, again = _watch(), list[str]()
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    while True:
        watch.longest_s = 0.0
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
        has_failed, stall_s = any(report.failed for report in reports), watch.longest_s
        if not has_failed or (again and stall_s < STALL_S) or len(again) + 1 == ATTEMPTS:
            break
        why = next(report.longreprtext.strip() for report in reports if report.failed)
        again.append(f"the longest sleep was {stall_s:.1f} s too long\n{why}")
        item._initrequest()  # type: ignore[attr-defined] # of functions: their fixtures are made anew
    for report in reports:
        if again:
            report.sections.append((RUN_AGAIN, "\n".join(again)))
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Names what passed only when it was run again."""
    for report in terminalreporter.stats.get("passed", []):
        for name, text in report.sections:
            if name == RUN_AGAIN and report.when == "call":
                terminalreporter.write_line(f"RUN AGAIN {report.nodeid}: {text}")
