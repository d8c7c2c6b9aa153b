"""Which capabilities can be used now: their component is working, and what they need is alive (DESIGN §6)."""

from collections.abc import Iterable
from typing import Final, NamedTuple

from gloc3.mission.model.abilities import abilities
from gloc3.platform.platform import Platform
from gloc3_onboard.command_server.book import ComponentBook
from gloc3_onboard.command_server.facts import VehicleFacts


class _Seen(NamedTuple):
    """What the last answer rests on."""

    working: frozenset[str]
    silent: frozenset[tuple[str, str]]
    is_pose_fresh: bool
    is_connected: bool


class Availability:
    """Follows each capability's needs: components, topics, capabilities, and the vehicle's pose and autopilot.

    A topic is there while a component that provides it works, and speaks on it.
    """

    def __init__(self, platform: Platform) -> None:
        self._platform: Final = platform
        self._producers: Final[dict[str, list[str]]] = {}
        for row in platform.components:
            for port in row.load_class().outputs:
                for topic in row.topics(port):
                    self._producers.setdefault(topic, []).append(row.name)
        self._needs: Final = {
            name: {need: self._who(need) for need in (row.performed_by, *row.needs) if need}
            for name, row in abilities(platform).items()
            if row.performed_by
        }
        """Of each capability: what it needs, and the components of which one must work for it."""
        self._seen: _Seen | None = None
        self._missing: dict[str, tuple[str, ...]] = {}

    def missing(self, book: ComponentBook, facts: VehicleFacts, now_s: float) -> dict[str, tuple[str, ...]]:
        """Capability to what it lacks, for those that cannot be used."""
        seen = _Seen(book.working(now_s), book.silent, facts.is_pose_fresh(now_s), facts.is_connected)
        if seen != self._seen:
            self._seen = seen
            self._missing = dict(self._find(seen))
        return self._missing

    def _find(self, seen: _Seen) -> Iterable[tuple[str, tuple[str, ...]]]:
        facts = {"pose": seen.is_pose_fresh, "autopilot": seen.is_connected}

        def is_alive(need: str, who: frozenset[str]) -> bool:
            return facts.get(need, any(one in seen.working and (one, need) not in seen.silent for one in who))

        for name, needs in self._needs.items():
            lacks = tuple(need for need, who in needs.items() if not is_alive(need, who))
            if lacks:
                yield name, lacks

    def _who(self, need: str) -> frozenset[str]:
        """The components of which one must work: itself, a capability's, or a topic's producers; and their standbys."""
        rows, capabilities = self._platform.components, self._platform.capabilities
        if any(row.name == need for row in rows):
            names = [need]
        elif need in capabilities:
            names = [capabilities[need].performed_by]
        else:
            names = self._producers.get(need, [])
        return frozenset([*names, *(row.name for row in rows if row.standby_for in names)])
