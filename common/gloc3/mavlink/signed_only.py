"""Lets the genuine frames of a signed link pass, and tells of the others in words, but not of each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from gloc3.mavlink.parser import Frame
from gloc3.mavlink.signing import Signing, Verdict

AGAIN_S: Final = 60.0
"""So often a person is told how many frames were dropped for their signature."""
HINTS: Final = {
    Verdict.UNSIGNED: "; is signing switched on there?",
    Verdict.FORGED: "; has it another key?",
    Verdict.REPEATED: "; is its clock right?",
    Verdict.FUTURE: "; which clock is wrong, its own or the one here?",
}


class SignedOnly:
    """The gate of one link.

    Args:
        signing: judges what is heard.
        told: is told in words what a person should know.
    """

    def __init__(self, signing: Signing, told: Callable[[str], None]) -> None:
        self._signing, self._told = signing, told
        self._told_s: dict[Verdict, float] = {}

    def passes(self, frame: Frame, now_s: float) -> bool:
        """Whether a frame may be used."""
        verdict = self._signing.verify(frame)
        if not verdict.is_good and now_s >= self._told_s.get(verdict, float("-inf")):
            self._told_s[verdict] = now_s + AGAIN_S
            count, who = self._signing.verdicts[verdict], f"{frame.system}/{frame.component}"
            so_far = f"{count} so far" if count > 1 else "and so will others be"
            self._told(f"a frame from {who} is dropped ({verdict}), {so_far}{HINTS.get(verdict, '')}")
        return verdict.is_good

    @property
    def genuine(self) -> int:
        """Frames with a right signature."""
        return self._signing.verdicts[Verdict.GENUINE]

    def refused(self) -> dict[str, int]:
        """By reason, how many frames were dropped."""
        return {
            str(verdict): count for verdict, count in self._signing.verdicts.items() if count and not verdict.is_good
        }
