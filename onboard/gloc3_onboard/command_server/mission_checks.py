"""Checks missions beside the control loop: a long one takes a second, and setpoints go on meanwhile."""

import sys
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any, Final, NamedTuple

from gloc3.errors import Refused
from gloc3.messages.command_interface import CiReply, CiRequest
from gloc3.mission.checking.checker import Circumstances, Report, check_text

MOST: Final = 8
"""Missions that wait for their check."""
SWITCH_S: Final = 0.001
"""So long the loop waits at most for each turn while a check computes; Python's own choice is five times that."""

Judge = Callable[[Report, float], CiReply | None]
"""What follows from a report, at a time; None if the answer comes later still."""


class Checked(NamedTuple):
    """A request whose mission is checked."""

    request: CiRequest
    report: "Future[Report]"
    judge: Judge

    def answer(self, now_s: float) -> CiReply | None:
        """Its answer."""
        return self.judge(self.report.result(), now_s)


class MissionChecks:
    """Has a worker check missions, one after the other.

    Args:
        worker: a thread in wall time; in virtual time, where nobody has to wait, `AtOnce`.
    """

    def __init__(self, worker: Executor) -> None:
        self._worker = worker
        self._waiting: deque[Checked] = deque()

    def answer(
        self, request: CiRequest, text: str, name: str, circumstances: Circumstances, judge: Judge, now_s: float
    ) -> CiReply | None:
        """Begins a check, and answers at once where it is done at once.

        Raises:
            Refused: too many are waiting.
        """
        if len(self._waiting) >= MOST:
            raise Refused(f"{MOST} missions are being checked already; ask again")
        checked = Checked(request, self._worker.submit(_check, text, name, circumstances), judge)
        if not self._waiting and checked.report.done():
            return checked.answer(now_s)
        self._waiting.append(checked)
        return None

    def due(self) -> list[Checked]:
        """The requests whose check is done, in the order in which they came."""
        found: list[Checked] = []
        while self._waiting and self._waiting[0].report.done():
            found.append(self._waiting.popleft())
        return found


class AtOnce(Executor):
    """Carries out what it is given before it returns."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        """As its base does, and it is done."""
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def _check(text: str, name: str, circumstances: Circumstances) -> Report:
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    try:
        return check_text(text, name, circumstances)
    finally:
        sys.setswitchinterval(before_s)
