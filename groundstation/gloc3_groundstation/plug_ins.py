"""Plug-ins from installed packages by entry point: screens, lines of the overview, alert rules.

They compute from snapshots and draw nothing themselves. One that fails is named in an event, and left out from then on.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import islice
from typing import Any, Final

import msgspec

from gloc3.component.workers import guard
from gloc3.installed import installed_points
from gloc3_groundstation.station.alerts import AlertCause
from gloc3_groundstation.station.snapshots import Fleet, PlatformSnapshot

SCREENS: Final = "gloc3.screens"
"""Entry points that load a `PlugInScreen`."""
OVERVIEW_LINES: Final = "gloc3.overview_lines"
"""Entry points that load an `OverviewLine`."""
ALERT_RULES: Final = "gloc3.alert_rules"
"""Entry points that load an `AlertRule`."""
MOST_LINES: Final = 1000
"""Lines of a screen, and causes of a rule, at most."""

OverviewLine = Callable[[PlatformSnapshot, float], str]
"""Text about a vehicle at a time of the station's clock, in s, below the name of the entry point; empty for none."""
AlertRule = Callable[[Fleet, float], Iterable[AlertCause]]
"""Active problems of a fleet at a time of the station's clock, in s."""


class PlugInScreen(msgspec.Struct, frozen=True, kw_only=True):
    """A screen of a package, which the palette offers."""

    title: str
    """One or two words."""
    help: str
    """Contents of the screen, in a few sentences."""
    lines: Callable[[Fleet, PlatformSnapshot | None, float], Sequence[str]]
    """Lines for the fleet and the vehicle in view at a time of the station's clock, in s."""


class PlugIns:
    """The plug-ins that are installed.

    Args:
        report: called with a line about each plug-in that fails.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._failed: set[tuple[str, str]] = set()
        self._loaded = {group: dict(self._load(group)) for group in (SCREENS, OVERVIEW_LINES, ALERT_RULES)}

    @property
    def screens(self) -> dict[str, PlugInScreen]:
        """Screens by name."""
        return self._loaded[SCREENS]

    def screen_lines(self, name: str, fleet: Fleet, platform: PlatformSnapshot | None, now_s: float) -> list[str]:
        """Lines of a screen; what it says of a screen that has failed."""
        lines = self._call(SCREENS, name, partial(_lines_of, self.screens[name], fleet, platform, now_s))
        return [f"{name} has failed; the screen Events (9) has the reason"] if lines is None else lines

    def overview(self, platform: PlatformSnapshot, now_s: float) -> tuple[tuple[str, str], ...]:
        """Names and texts of the lines about a vehicle."""
        found = []
        for name, line in self._loaded[OVERVIEW_LINES].items():
            text = self._call(OVERVIEW_LINES, name, partial(_text_of, line, platform, now_s))
            if text:
                found.append((name, text))
        return tuple(found)

    def causes(self, fleet: Fleet, now_s: float) -> list[AlertCause]:
        """Active problems that the rules find, each named after its rule."""
        found: list[AlertCause] = []
        for name, rule in self._loaded[ALERT_RULES].items():
            found += self._call(ALERT_RULES, name, partial(_causes_of, rule, fleet, now_s)) or []
        return [msgspec.structs.replace(cause, what=f"{cause.what} (plug-in)") for cause in found]

    def _load(self, group: str) -> Iterator[tuple[str, Any]]:
        for point in installed_points(group):
            found = self._call(group, point.name, point.load)
            if found is not None and (isinstance(found, PlugInScreen) if group == SCREENS else callable(found)):
                yield point.name, found
            elif (group, point.name) not in self._failed:
                self._fail(group, point.name, f"{point.value} is of another kind")

    def _call(self, group: str, name: str, job: Callable[[], Any]) -> Any:
        """The result of a plug-in; None where it fails, or has failed before."""
        if (group, name) in self._failed:
            return None
        result, error = guard(job)
        if error is not None:
            self._fail(group, name, f"{type(error).__name__}: {error}")
        return result

    def _fail(self, group: str, name: str, reason: str) -> None:
        self._failed.add((group, name))
        self._report(f"plug-in {name} ({group}) is left out: {' '.join(reason.split())}")


def _lines_of(screen: PlugInScreen, fleet: Fleet, platform: PlatformSnapshot | None, now_s: float) -> list[str]:
    return [str(line) for line in islice(screen.lines(fleet, platform, now_s), MOST_LINES)]


def _text_of(line: OverviewLine, platform: PlatformSnapshot, now_s: float) -> str:
    return " ".join(line(platform, now_s).split())


def _causes_of(rule: AlertRule, fleet: Fleet, now_s: float) -> list[AlertCause]:
    """The causes that a rule finds.

    Raises:
        TypeError: it gives something else.
    """
    found = list(islice(rule(fleet, now_s), MOST_LINES))
    for cause in found:
        if not isinstance(cause, AlertCause):
            raise TypeError(f"a rule gives AlertCause, not {type(cause).__name__}")
    return [msgspec.convert(msgspec.to_builtins(cause), AlertCause) for cause in found]  # its fields are checked
