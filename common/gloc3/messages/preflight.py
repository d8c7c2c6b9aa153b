"""The pre-flight list: one check a line, each with a verdict, a finding and advice."""

from collections.abc import Iterable, Sequence
from enum import StrEnum
from typing import Final

import msgspec

from gloc3.messages.envelope import Message


class Verdict(StrEnum):
    """Results of a check, best first."""

    OK = "ok"
    UNKNOWN = "unknown"
    """It could not be checked; the start is not refused for it."""
    WARNING = "warning"
    """Worth knowing; the start is not refused for it."""
    RED = "red"
    """The start is refused, unless an operator overrides it by name."""


SEVERITY: Final = {verdict: rank for rank, verdict in enumerate(Verdict)}


class Group(StrEnum):
    """Subjects of the checks, in the order of the list."""

    AUTOPILOT = "autopilot"
    FAILSAFES = "failsafes"
    SENSORS = "sensors"
    COMPONENTS = "components"
    MISSION = "mission"
    COMPUTER = "computer"
    LINK = "link"


class Check(msgspec.Struct, frozen=True, array_like=True):
    """One line of the list."""

    group: Group
    name: str
    """Name of the check, one or two words; unique in its group."""
    verdict: Verdict
    finding: str
    """What was found, in words, with figures."""
    advice: str = ""
    """What to do; empty where nothing need be done."""
    may_settle: bool = False
    """Such a finding often passes by itself, within a minute of power-up: a start may wait for it."""

    @property
    def title(self) -> str:
        """The line's name with its group."""
        return f"{self.group}: {self.name}"

    def __str__(self) -> str:
        advice = f" -> {self.advice}" if self.advice else ""
        return f"{self.verdict:<7}  {self.title}: {self.finding}{advice}"


class PreflightReport(Message, frozen=True):
    """A platform's own list, as it was at one moment."""

    checks: list[Check]
    version: str
    """Of the software onboard."""
    utc_s: float | None = None
    """The platform's UTC at that moment, in seconds since 1970."""
    protocol: str = ""
    """Hash of its protocol, see `gloc3.messages.software`."""


def red(checks: Iterable[Check]) -> list[Check]:
    """The lines that refuse a start."""
    return [check for check in checks if check.verdict is Verdict.RED]


def worst(checks: Iterable[Check]) -> Verdict:
    """The worst verdict; ok for an empty list."""
    return max((check.verdict for check in checks), key=SEVERITY.__getitem__, default=Verdict.OK)


def in_order(checks: Iterable[Check]) -> list[Check]:
    """Lines ordered by group, each group in the given order."""
    order = list(Group)
    return sorted(checks, key=lambda check: order.index(check.group))


def summary(checks: Sequence[Check]) -> str:
    """The list in a few words, worst first."""
    counts = {verdict: sum(check.verdict is verdict for check in checks) for verdict in Verdict}
    words = [f"{counts[verdict]} {verdict}" for verdict in reversed(Verdict) if counts[verdict]]
    return ", ".join(words) or "nothing was checked"
