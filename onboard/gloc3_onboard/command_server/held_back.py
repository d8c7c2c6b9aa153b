"""What stations are told waits for the disk: no action is reported started before that is kept (DESIGN §6)."""

from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

from gloc3.component.ports import Result
from gloc3.messages.command_interface import CiReply
from gloc3.messages.summaries import CiEvent, MissionSummary
from gloc3_onboard.command_server.site import Mark, Site

AT_ONCE_S: Final = 0.02
"""A disk that is done so soon is waited for in the cycle itself; no setpoint is late for that."""
LONGEST_S: Final = 1.0
"""Nobody on the ground waits longer for a slow disk."""
TOLD: Final = (CiReply, CiEvent, MissionSummary)


class _Held(NamedTuple):
    mark: Mark
    until_s: float
    results: Sequence[Result]


class HeldBack:
    """Keeps replies, events and the mission's state back while what was kept before them is on its way to the disk.

    Args:
        site: what is kept there.
    """

    def __init__(self, site: Site) -> None:
        self.problem = ""
        """Why something was told that is not kept yet; empty where that is not so."""
        self._site = site
        self._held: deque[_Held] = deque()

    def pass_on(self, results: Sequence[Result], now_s: float) -> list[Result]:
        """What may be told now of the results of a cycle, and of those before."""
        told = [result for result in results if isinstance(result, TOLD)]
        if told:
            self._held.append(_Held(self._site.mark(), now_s + LONGEST_S, told))
        passed: list[Result] = []
        patience_s = AT_ONCE_S if len(self._held) == 1 and told else 0.0
        while self._held:
            held = self._held[0]
            is_kept = self._site.wait(held.mark, patience_s)
            if not is_kept and now_s < held.until_s:
                break
            self.problem = "" if is_kept else "the disk takes more than a second to keep anything"
            passed += self._held.popleft().results
        return [*passed, *(result for result in results if not isinstance(result, TOLD))]
