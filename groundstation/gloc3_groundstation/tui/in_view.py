"""The selected vehicle: the requested one, the last session's, or the first one in contact; it then stays selected."""

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
        self.name = requested or last
        """The vehicle that is, or is to be, in view; empty while none is known."""

    def platform(self, fleet: Fleet) -> PlatformSnapshot | None:
        """The selected platform; None before the first contact, or while the requested one is awaited."""
        found = fleet.get(self.name)
        return found if found is not None or self._is_fixed else _first(fleet)

    def settle(self, fleet: Fleet, now_s: float) -> None:
        """Fixes the first platform in contact as the selection, so that it does not change during input."""
        first = _first(fleet)
        is_late = first is not None and now_s - first.first_received_s >= WAITS_S
        if first is not None and is_late and not self._is_fixed and fleet.get(self.name) is None:
            self.name = first.name

    def show_vehicle(self, name: str) -> None:
        """Brings a platform into view."""
        self._is_fixed, self.name = False, name

    def cycle(self, fleet: Fleet, step: int) -> None:
        """Brings the next platform into view, or the one before."""
        platform, names = self.platform(fleet), list(fleet.platforms)
        if platform is not None:
            self.show_vehicle(names[(names.index(platform.name) + step) % len(names)])


def _first(fleet: Fleet) -> PlatformSnapshot | None:
    """The first platform in contact; vehicles without a GLOC3 companion come last."""
    return next((platform for platform in fleet if platform.has_companion), next(iter(fleet), None))
