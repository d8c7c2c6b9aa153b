"""Which capabilities can be used now: their component is working, and what they need is alive (DESIGN §6)."""

from typing import Final

from gloc3.platform import Platform
from gloc3_onboard.command_server.book import ComponentBook
from gloc3_onboard.command_server.facts import VehicleFacts


class Availability:
    """Follows each capability's needs: components, other capabilities, and the vehicle's pose and autopilot."""

    def __init__(self, platform: Platform) -> None:
        self._platform: Final = platform
        self._producers: Final[dict[str, list[str]]] = {}
        for row in platform.components:
            for port in row.load_class().outputs:
                for topic in row.topics(port):
                    self._producers.setdefault(topic, []).append(row.name)

    def missing(self, book: ComponentBook, facts: VehicleFacts, now_s: float) -> dict[str, tuple[str, ...]]:
        """Capability to what it lacks, for those that cannot be used."""
        lacking: dict[str, tuple[str, ...]] = {}
        for name, row in self._platform.capabilities.items():
            wanted = ([row.performed_by] if row.performed_by else []) + list(row.needs)
            lacks = tuple(need for need in wanted if not self._is_there(need, book, facts, now_s))
            if lacks:
                lacking[name] = lacks
        return lacking

    def _is_there(self, need: str, book: ComponentBook, facts: VehicleFacts, now_s: float) -> bool:
        if need == "pose":
            return facts.is_pose_fresh(now_s)
        if need == "autopilot":
            return facts.is_connected
        if need in book.rows:
            return self._does_somebody_work([need], book, now_s)
        if need in self._platform.capabilities:
            return self._is_there(self._platform.capabilities[need].performed_by, book, facts, now_s)
        return self._does_somebody_work(self._producers.get(need, []), book, now_s)

    def _does_somebody_work(self, names: list[str], book: ComponentBook, now_s: float) -> bool:
        """Whether one of some components works, or a standby of one of them."""
        standbys = [row.name for row in book.rows.values() if row.standby_for in names]
        return any(book.is_working(name, now_s) for name in [*names, *standbys])
