"""Rows of a list of vehicles, rebuilt only where something has changed, to stay fast with 100 vehicles."""

from collections.abc import Callable
from typing import Final

from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line
from gloc3_groundstation.tui.widgets.panel import ListPanel, Row

OLDER_EVERY_S: Final = 0.5
"""Interval at which a row is rebuilt even without changes, s, because its ages advance."""


class VehicleRows:
    """The rows of one list, each with the values that it was built from."""

    def __init__(self) -> None:
        self._made: dict[str, tuple[tuple[object, ...], Line]] = {}

    def rows(
        self, panel: ListPanel, view: StationView, make: Callable[[PlatformSnapshot], Line], of: object = None
    ) -> list[Row]:
        """A row for each vehicle; empty for one that is not visible.

        Args:
            panel: the panel that shows them.
            view: the current view.
            make: builds the line of a vehicle.
            of: what the lines depend on besides the vehicle and the selection.
        """
        rows, before, self._made = [], self._made, {}
        for index, platform in enumerate(view.fleet):
            line = EMPTY
            if panel.shows(index):
                made_of = (platform, platform is view.platform, of, panel.width, view.now_s // OLDER_EVERY_S)
                kept = before.get(platform.name)
                line = kept[1] if kept is not None and kept[0] == made_of else make(platform)
                self._made[platform.name] = made_of, line
            rows.append(Row(line, platform.name))
        return rows
