"""Narration of a headless station: changes between two snapshots of a fleet, and periodic progress."""

from collections.abc import Iterator
from typing import Any, Final

import msgspec

from gloc3.messages.envelope import Severity
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.snapshots import Fleet, PlatformSnapshot

LOUDEST_UNTOLD: Final = Severity.INFO
"""Events of platforms from this severity down are not narrated: changes of state are reported anyway."""


class NarrationLine(msgspec.Struct, frozen=True, kw_only=True):
    """One line of narration: a sentence for people, and the same as data for programs."""

    t_s: float
    """Seconds since the station's start."""
    platform: str
    kind: str
    """`event`, `vehicle`, `component`, `mission`, `task`, `action`, `progress`, `command` or `result`."""
    text: str
    data: dict[str, Any] = {}

    def __str__(self) -> str:
        who = f"{self.platform}  " if self.platform else ""
        return f"{self.t_s:7.1f} s  {who}{self.text}"


class ChangeNarrator:
    """Turns changes into lines; its times count from `start_s`."""

    def __init__(self, start_s: float) -> None:
        self._start_s = start_s

    def changes(self, before: Fleet, after: Fleet, now_s: float) -> Iterator[NarrationLine]:
        """The lines that describe the difference between two snapshots."""
        for event in after.events_after(before.event_count):
            if event.source and event.severity >= LOUDEST_UNTOLD:
                continue
            data = {"severity": event.severity.name.lower(), "source": event.source, "text": event.text}
            text = f"{event.source}: {event.text}" if event.source else event.text
            yield self.line(event.platform, "event", _loud(event.severity) + text, now_s, data)
        for name, platform in after.platforms.items():
            was = before.get(name)
            if platform is not was:
                yield from self._vehicle(was, platform, now_s)
                yield from self._mission(was, platform, now_s)
                yield from self._components(was, platform, now_s)

    def progress(self, platform: PlatformSnapshot, now_s: float) -> NarrationLine:
        """Where the vehicle and its mission are now."""
        parts, data = [], {}
        if platform.mission is not None and (doing := wording.running(platform.mission.value)):
            parts.append(doing)
        if platform.vehicle is not None:
            vehicle = platform.vehicle.value
            parts += [wording.position(vehicle), f"{vehicle.speed_m_s:.1f} m/s", wording.battery(vehicle)]
            data = {"vehicle": msgspec.to_builtins(vehicle), "age_s": platform.vehicle.age_s(now_s)}
        if platform.mission is not None:
            data["mission"] = msgspec.to_builtins(platform.mission.value)
        if arrives := wording.arrival(platform):
            parts.append(arrives)
        if silent := wording.silence(platform, now_s):
            parts = [silent, *(["last seen: " + "; ".join(parts)] if parts else [])]
        return self.line(platform.name, "progress", "; ".join(parts) or "nothing known yet", now_s, data)

    def line(
        self, platform: str, kind: str, text: str, now_s: float, data: dict[str, Any] | None = None
    ) -> NarrationLine:
        """A narration line with the current time."""
        return NarrationLine(
            t_s=round(now_s - self._start_s, 3), platform=platform, kind=kind, text=text, data=data or {}
        )

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
            parts.append(f"mode {new.mode}" if new.mode else "mode unknown")
        if (previous is not None and previous.has_pilot_control) != new.has_pilot_control:
            parts.append(
                f"{wording.controller(new)} has control"
                if new.has_pilot_control or previous is None
                else f"{wording.controller(previous)} has handed back"
            )
        if (previous is None or previous.is_autopilot_connected) != new.is_autopilot_connected:
            parts.append("autopilot connected" if new.is_autopilot_connected else "NO AUTOPILOT")
        if parts:
            yield self.line(platform.name, "vehicle", ", ".join(parts), now_s, msgspec.to_builtins(new))

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
                yield self.line(platform.name, "mission", "no mission is loaded any more", now_s)
            return
        for item in wording.items(new):
            if previous is None or not is_same or previous.tasks.get(item.target) == item.state:
                continue
            kind = "task" if item.is_task else "action"
            data = {"target": item.target, "state": item.state}
            yield self.line(platform.name, kind, f"{kind} {item.target}: {item.state}", now_s, data)
        if (
            previous is None
            or not is_same
            or (previous.state, previous.reason, previous.policy) != (new.state, new.reason, new.policy)
        ):
            text = f"mission {new.name!r}: {new.state}"
            text += (f", policy {new.policy}" if new.policy else "") + (f" ({new.reason})" if new.reason else "")
            data = {"name": new.name, "state": new.state, "policy": new.policy, "reason": new.reason}
            yield self.line(platform.name, "mission", text, now_s, data)

    def _components(
        self, was: PlatformSnapshot | None, platform: PlatformSnapshot, now_s: float
    ) -> Iterator[NarrationLine]:
        if was is None or platform.lines is was.lines or platform.table is None or was.table is not platform.table:
            return
        for previous, new in zip(was.components(now_s), platform.components(now_s), strict=True):
            if previous.health is not None and new.health is not None and previous.health is not new.health:
                cause = f" ({new.cause})" if new.cause and not new.is_well else ""
                text = f"component {new.name}: {new.health}{cause}"
                data = {"name": new.name, "state": new.health.value, "cause": new.cause}
                yield self.line(platform.name, "component", text, now_s, data)


def _loud(severity: Severity) -> str:
    """Severity as a prefix of a sentence; empty for events that are no problem."""
    return f"{severity.name.lower()}: " if severity <= Severity.WARNING else ""
