"""Narration of a fleet: its health at the first contact, changes between two snapshots, and periodic progress."""

from collections.abc import Iterator
from typing import Final

import msgspec

from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import MissionSummary, VehicleSummary
from gloc3_groundstation.reporting.lines import (
    ComponentData,
    EventData,
    HealthData,
    ItemData,
    MissionData,
    NarrationLine,
    NoData,
    ProgressData,
    utc_time,
)
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.snapshots import Fleet, PlatformSnapshot

LOUDEST_UNTOLD: Final = Severity.INFO
"""Events of platforms from this severity down are not narrated: changes of state are reported anyway."""
INTRODUCED_WITHIN_S: Final = 3.0
"""Longest time for which the changes of a new platform wait until its whole state is known, s."""


class ChangeNarrator:
    """Turns changes into lines.

    A platform is introduced by a line about its health; what changes before that is part of this line.

    Args:
        start_s: where the lines' times begin.
        utc_offset_s: seconds from the station's time to seconds since 1970.
    """

    def __init__(self, start_s: float, utc_offset_s: float) -> None:
        self._start_s, self._utc_offset_s = start_s, utc_offset_s
        self._introduced: dict[str, int] = {}
        """Platforms to the life in which they were introduced."""

    def changes(self, before: Fleet, after: Fleet, now_s: float) -> Iterator[NarrationLine]:
        """The lines that describe the difference between two snapshots."""
        for event in after.events_after(before.event_count):
            if event.source and event.severity >= LOUDEST_UNTOLD:
                continue
            text = f"{event.source}: {event.text}" if event.source else event.text
            data = _event(event.severity, event.source, event.text)
            yield self.line(event.platform, "event", _loud(event.severity) + text, now_s, data)
        for name, platform in after.platforms.items():
            was = before.get(name)
            if self._introduced.get(name) != platform.boot:
                yield from self._introduction(platform, now_s)
            elif platform is not was:
                yield from self._vehicle(was, platform, now_s)
                yield from self._mission(was, platform, now_s)
                yield from self._components(was, platform, now_s)

    def _introduction(self, platform: PlatformSnapshot, now_s: float) -> Iterator[NarrationLine]:
        """The first line about a platform, once its whole state is known, or after a while what is known of it."""
        began_s = max(platform.first_received_s, platform.began_s)
        if not _is_complete(platform) and now_s - began_s < INTRODUCED_WITHIN_S:
            return
        self._introduced[platform.name] = platform.boot
        mission, vehicle = _mission_of(platform), _vehicle_of(platform)
        components = platform.components(now_s)
        data = HealthData(
            health=platform.summary.value.health.value if platform.summary is not None else "",
            components=len(components),
            troubled={one.name: one.health.value for one in components if one.health is not None and not one.is_well},
            mission=mission,
            vehicle=vehicle,
            holder=platform.control.value.holder if platform.control is not None else "",
        )
        parts = [wording.components(platform, now_s), *([_mission_text(mission)] if mission is not None else [])]
        if vehicle is not None:
            parts += [_mode(platform), wording.arming(vehicle), wording.battery(vehicle)]
        if data.holder:
            parts.append(f"station {data.holder} in control")
        yield self.line(platform.name, "health", "; ".join(parts), now_s, data)

    def progress(self, platform: PlatformSnapshot, now_s: float) -> NarrationLine:
        """Where the vehicle and its mission are now."""
        parts = []
        mission, vehicle = _mission_of(platform), _vehicle_of(platform)
        if mission is not None and (doing := wording.running(mission)):
            parts.append(doing)
        age_s = None
        if platform.vehicle is not None:
            vehicle, age_s = platform.vehicle.value, platform.vehicle.age_s(now_s)
            parts += [wording.position(vehicle), f"{vehicle.speed_m_s:.1f} m/s", wording.battery(vehicle)]
        data = ProgressData(vehicle=vehicle, age_s=age_s, mission=mission)
        if arrives := wording.arrival(platform):
            parts.append(arrives)
        if silent := wording.silence(platform, now_s):
            parts = [silent, *(["last seen: " + "; ".join(parts)] if parts else [])]
        return self.line(platform.name, "progress", "; ".join(parts) or "nothing known yet", now_s, data)

    def line(
        self, platform: str, kind: str, text: str, now_s: float, data: msgspec.Struct | None = None
    ) -> NarrationLine:
        """A line with the current time."""
        return NarrationLine(
            utc=utc_time(now_s + self._utc_offset_s),
            t_s=round(now_s - self._start_s, 3),
            platform=platform,
            kind=kind,
            text=text,
            data=data or NoData(),
        )

    def remark(self, text: str, now_s: float, severity: Severity = Severity.INFO) -> NarrationLine:
        """A line of the station's own."""
        return self.line("", "event", _loud(severity) + text, now_s, _event(severity, "", text))

    def _vehicle(
        self, was: PlatformSnapshot | None, platform: PlatformSnapshot, now_s: float
    ) -> Iterator[NarrationLine]:
        if platform.vehicle is None:
            return
        new = platform.vehicle.value
        previous = was.vehicle.value if was and was.vehicle else None
        parts = []
        if previous is None or (previous.is_armed, previous.landed) != (new.is_armed, new.landed):
            parts.append(wording.arming(new))
        if previous is None or previous.mode != new.mode:
            parts.append(_mode(platform))
        if (previous is not None and previous.has_pilot_control) != new.has_pilot_control:
            parts.append(
                f"{wording.controller(new)} has control"
                if new.has_pilot_control or previous is None
                else f"{wording.controller(previous)} has handed back"
            )
        if (previous is None or previous.is_autopilot_connected) != new.is_autopilot_connected:
            parts.append("autopilot connected" if new.is_autopilot_connected else "NO AUTOPILOT")
        if parts:
            yield self.line(platform.name, "vehicle", ", ".join(parts), now_s, new)

    def _mission(
        self, was: PlatformSnapshot | None, platform: PlatformSnapshot, now_s: float
    ) -> Iterator[NarrationLine]:
        if platform.mission is None:
            return
        new = platform.mission.value
        previous = was.mission.value if was and was.mission else None
        is_same = previous is not None and previous.digest == new.digest
        if not is_same and not new.state:
            if previous is not None and previous.state:
                data = MissionData(name="", state="", policy="", reason="")
                yield self.line(platform.name, "mission", "no mission is loaded any more", now_s, data)
            return
        for item in wording.items(new):
            if previous is None or not is_same or previous.tasks.get(item.target) == item.state:
                continue
            kind = "task" if item.is_task else "action"
            state = ItemData(target=item.target, state=item.state)
            yield self.line(platform.name, kind, f"{kind} {item.target}: {item.state}", now_s, state)
        if (
            previous is None
            or not is_same
            or (previous.state, previous.reason, previous.policy) != (new.state, new.reason, new.policy)
        ):
            change = MissionData(name=new.name, state=new.state, policy=new.policy, reason=new.reason)
            yield self.line(platform.name, "mission", _mission_text(new), now_s, change)

    def _components(
        self, was: PlatformSnapshot | None, platform: PlatformSnapshot, now_s: float
    ) -> Iterator[NarrationLine]:
        if was is None or platform.lines is was.lines or platform.table is None or was.table is not platform.table:
            return
        for previous, new in zip(was.components(now_s), platform.components(now_s), strict=True):
            if previous.health is not None and new.health is not None and previous.health is not new.health:
                cause = f" ({new.cause})" if new.cause and not new.is_well else ""
                text = f"component {new.name}: {new.health}{cause}"
                data = ComponentData(name=new.name, state=new.health.value, cause=new.cause)
                yield self.line(platform.name, "component", text, now_s, data)


def _is_complete(platform: PlatformSnapshot) -> bool:
    """Whether everything is known that its first line is about."""
    if not platform.has_companion:
        return platform.vehicle is not None
    table = platform.table
    is_summed = platform.summary is not None and table is not None and len(platform.lines) >= len(table.rows)
    return is_summed and None not in (platform.vehicle, platform.mission, platform.control)


def _mission_of(platform: PlatformSnapshot) -> MissionSummary | None:
    return platform.mission.value if platform.mission is not None else None


def _vehicle_of(platform: PlatformSnapshot) -> VehicleSummary | None:
    return platform.vehicle.value if platform.vehicle is not None else None


def _mission_text(mission: MissionSummary) -> str:
    """`mission 'patrol': paused, policy pilot (the pilot has control)`, or that none is loaded."""
    if not mission.state:
        return "no mission"
    text = f"mission {mission.name!r}: {mission.state}" + (f", policy {mission.policy}" if mission.policy else "")
    return text + (f" ({mission.reason})" if mission.reason else "")


def _mode(platform: PlatformSnapshot) -> str:
    words = wording.mode(platform)
    return f"mode {words}" if words else "mode unknown"


def _event(severity: Severity, source: str, text: str) -> EventData:
    return EventData(severity=severity.name.lower(), source=source, text=text)


def _loud(severity: Severity) -> str:
    """Severity as a prefix of a sentence; empty for events that are no problem."""
    return f"{severity.name.lower()}: " if severity <= Severity.WARNING else ""
