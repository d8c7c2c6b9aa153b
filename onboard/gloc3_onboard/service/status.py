"""Status line of the service, as `systemctl status` shows it and as `gloc3 update` reads it again."""

import re
from collections.abc import Sequence
from typing import Final

import msgspec

from gloc3.component.lci import State
from gloc3.messages.summaries import WELL, Health, MissionSummary, Summary, VehicleSummary, health_of

DISARMED: Final = "disarmed"
NO_AUTOPILOT: Final = "no autopilot is connected"
_LINE: Final = re.compile(r"(\S+) is ([a-z]+): (\d+) of (\d+) components work")


class ServiceStatus(msgspec.Struct, frozen=True, kw_only=True):
    """State of an onboard process in one line."""

    platform: str
    """The platform; PLATFORM-HOST for a host of several that has no command server."""
    health: str
    """The worst of the required components."""
    well: int
    """Components that do what they should."""
    total: int
    details: tuple[str, ...] = ()
    """What hangs, the vehicle and the mission, in the words of the line."""

    @classmethod
    def of(
        cls,
        platform: str,
        summary: Summary,
        hung: dict[str, str],
        vehicle: VehicleSummary | None,
        mission: MissionSummary | None,
    ) -> "ServiceStatus":
        """The status that the summaries give; `hung` has the cause of each component that hangs."""
        return cls._of(
            platform, str(summary.health), [list(Health)[line.state] for line in summary.lines], hung, vehicle, mission
        )

    @classmethod
    def of_host(
        cls,
        place: str,
        states: Sequence[tuple[State | None, bool]],
        hung: dict[str, str],
        vehicle: VehicleSummary | None,
    ) -> "ServiceStatus":
        """The status of a host that has no command server.

        Args:
            place: PLATFORM-HOST.
            states: of its components; each with whether it is required.
            hung: the cause of each component that hangs.
            vehicle: the latest news of the vehicle; None for none.
        """
        healths = [health_of(state) for state, _ in states]
        required = [health_of(state) for state, is_required in states if is_required]
        worst = max(required, key=list(Health).index, default=Health.WORKING)
        return cls._of(place, str(worst), healths, hung, vehicle, None)

    @classmethod
    def _of(
        cls,
        place: str,
        health: str,
        healths: Sequence[Health],
        hung: dict[str, str],
        vehicle: VehicleSummary | None,
        mission: MissionSummary | None,
    ) -> "ServiceStatus":
        details = [f"{name} {cause}" for name, cause in hung.items()]
        if vehicle is not None:
            details.append(_vehicle(vehicle))
        if mission is not None and mission.name:
            details.append(
                f"mission {mission.name!r} {mission.state}" + (f", {mission.policy}" if mission.policy else "")
            )
        return cls(
            platform=place,
            health=health,
            well=sum(health in WELL for health in healths),
            total=len(healths),
            details=tuple(details),
        )

    @classmethod
    def parse(cls, text: str) -> "ServiceStatus | None":
        """The status of a line; None for another text, such as *stopping*."""
        first, *details = text.split("; ")
        if (found := _LINE.fullmatch(first)) is None:
            return None
        platform, health, well, total = found.groups()
        return cls(platform=platform, health=health, well=int(well), total=int(total), details=tuple(details))

    def text(self) -> str:
        """The line."""
        first = f"{self.platform} is {self.health}: {self.well} of {self.total} components work"
        return "; ".join([first, *self.details])

    @property
    def failing(self) -> int:
        """Components that do not do what they should."""
        return self.total - self.well

    @property
    def is_disarmed(self) -> bool | None:
        """Whether the vehicle is disarmed; None where no autopilot says so."""
        if any(one.startswith(f"{DISARMED}, ") for one in self.details):
            return True
        return False if any(one.startswith("armed, ") for one in self.details) else None


def _vehicle(vehicle: VehicleSummary) -> str:
    if not vehicle.is_autopilot_connected:
        return NO_AUTOPILOT
    armed = "armed" if vehicle.is_armed else DISARMED
    who = "the autopilot's failsafe" if vehicle.is_failsafe else "an operator" if vehicle.is_operators else "a pilot"
    pilot = f", {who} has control" if vehicle.has_pilot_control else ""
    return f"{armed}, {vehicle.landed.replace('_', ' ')}, {vehicle.mode}{pilot}"
