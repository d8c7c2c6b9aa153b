"""The selected vehicle: the requested one, the last session's, or the first one in contact; it then stays selected.

A vehicle that gets another name stays selected. One that is no longer shown leaves nothing selected: no other vehicle
receives the commands that were meant for it.
"""

from typing import Final

from gloc3_groundstation.station.snapshots import Fleet, PlatformSnapshot

WAITS_S: Final = 5.0
"""Time after the first contact for which the last session's platform is awaited, s."""


class InView:
    """The choice, and the operator's changes of it."""

    def __init__(self, requested: str | None, last: str) -> None:
        """A choice.

        Args:
            requested: waited for as long as it takes; None without one.
            last: of the last session; empty without one.
        """
        self._is_fixed = requested is not None
        """Whether no other vehicle comes into view by itself."""
        self.name = requested or last
        """The vehicle that is, or is to be, in view; empty while none is known."""

    def platform(self, fleet: Fleet) -> PlatformSnapshot | None:
        """The selected platform; None before the first contact, and while the selected one is not there."""
        found = self._named(fleet)
        return found if found is not None or self._is_fixed else _first(fleet)

    def settle(self, fleet: Fleet, now_s: float) -> None:
        """Fixes the platform in view as the selection, so that it does not change during input."""
        found, first = self._named(fleet), _first(fleet)
        if found is None and not self._is_fixed and first is not None and now_s - first.first_received_s >= WAITS_S:
            found = first
        if found is not None:
            self.show_vehicle(found.name)

    def show_vehicle(self, name: str) -> None:
        """Brings a platform into view."""
        self._is_fixed, self.name = True, name

    def cycle(self, fleet: Fleet, step: int) -> None:
        """Brings the next platform into view, or the one before; without one in view, the first or the last."""
        platform, names = self.platform(fleet), list(fleet.platforms)
        if names:
            place = names.index(platform.name) if platform is not None else -(step > 0)
            self.show_vehicle(names[(place + step) % len(names)])

    def _named(self, fleet: Fleet) -> PlatformSnapshot | None:
        """The platform of the name, or of the one that it has got since."""
        return fleet.get(self.name) or fleet.get(fleet.renamed.get(self.name, ""))


def _first(fleet: Fleet) -> PlatformSnapshot | None:
    """The first platform in contact; vehicles without a GLOC3 companion come last."""
    return next((platform for platform in fleet if platform.has_companion), next(iter(fleet), None))
