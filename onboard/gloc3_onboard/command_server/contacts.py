"""Contact with stations: the reports after a loss of contact, and those stored while no station is in contact."""

from typing import Final

from gloc3.messages.command_interface import CiReply, CiRequest, ReadReports, StationRole
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import CiEvent, ContactSummary, Health, MissionSummary, VehicleSummary
from gloc3_onboard.command_server.journal import answer
from gloc3_onboard.command_server.report_store import ReportStore

OUT_OF_CONTACT_S: Final = 5.0
"""Time without a message after which a station is out of contact, s."""
STATUS_PERIOD_S: Final = 30.0
"""Period at which the state is stored as an event while no station is in contact, s."""
MOST_AT_ONCE: Final = 100
MOST_STATIONS: Final = 32
"""Number of stations whose last contact is remembered."""
SOURCE: Final = "status"


class Contacts:
    """Last contact of each station, and the reports that follow.

    Args:
        reports: what the platform has told.
    """

    def __init__(self, reports: ReportStore) -> None:
        self._reports = reports
        self._received_s: dict[str, float] = {}
        self._new: dict[str, float] = {}
        self._kept_s: float | None = None

    def note_contact(self, station: str, now_s: float) -> None:
        """Registers contact with a station."""
        before_s = self._received_s.get(station)
        if before_s is None or now_s - before_s >= OUT_OF_CONTACT_S:
            self._new[station] = -1.0 if before_s is None else now_s - before_s
            self._reports.owe()
        self._received_s.pop(station, None)
        self._received_s[station] = now_s
        if len(self._received_s) > MOST_STATIONS:
            oldest = next(iter(self._received_s))
            del self._received_s[oldest]
            self._new.pop(oldest, None)

    def is_alone(self, now_s: float) -> bool:
        """Whether no station is in contact."""
        return all(now_s - received_s >= OUT_OF_CONTACT_S for received_s in self._received_s.values())

    def is_due(self, now_s: float, *, is_silent: bool) -> bool:
        """Whether the state has to be stored: periodically, while the vehicle is under way out of contact."""
        if not is_silent:
            self._kept_s = None
        elif self._kept_s is None:
            self._kept_s = now_s
        return self._kept_s is not None and now_s - self._kept_s >= STATUS_PERIOD_S

    def status(self, vehicle: VehicleSummary, mission: MissionSummary, now_s: float) -> CiEvent:
        """The state as an event."""
        self._kept_s = now_s
        x_m, y_m, height_m = vehicle.position_m
        parts = [f"x {x_m:.1f} y {y_m:.1f} h {height_m:.1f} m", f"{vehicle.speed_m_s:.1f} m/s"]
        parts += [f"battery {vehicle.battery_percent} %"] if vehicle.battery_percent >= 0 else []
        parts += [doing] if (doing := _doing(mission)) else []
        return CiEvent(severity=Severity.INFO, source=SOURCE, text="; ".join(parts), t_s=now_s)

    def collect(
        self, health: Health, vehicle: VehicleSummary, mission: MissionSummary, conditions: list[str], now_s: float
    ) -> list[ContactSummary]:
        """Summaries for stations just heard after a silence."""
        found = []
        for station, silent_s in self._new.items():
            since_s = now_s - silent_s if silent_s >= 0.0 else float("-inf")
            missed = [event for event in self._reports.undelivered() if event.t_s >= since_s]
            worst = min(missed, key=lambda event: event.severity, default=None)
            found.append(
                ContactSummary(
                    station=station,
                    t_s=round(now_s, 3),
                    silent_s=round(silent_s, 1),
                    health=health,
                    mission=mission.name,
                    state=mission.state,
                    doing=_doing(mission),
                    policy=mission.policy,
                    landed=vehicle.landed,
                    battery_percent=vehicle.battery_percent,
                    position_m=vehicle.position_m,
                    geo=vehicle.geo,
                    conditions=conditions,
                    store=self._reports.id,
                    last=self._reports.last,
                    delivered=self._reports.delivered,
                    worst=int(worst.severity) if worst is not None else int(Severity.DEBUG),
                    worst_text=f"{worst.source}: {worst.text}"[:120] if worst is not None else "",
                )
            )
        self._new.clear()
        return found

    @property
    def has_reports(self) -> bool:
        """Whether a station was just heard after a silence."""
        return bool(self._new)

    def read(self, request: CiRequest, body: ReadReports) -> CiReply:
        """The events requested by a station; delivery to an operator counts as delivery to all stations."""
        reports = self._reports
        after = body.after if body.store == reports.id else 0
        if body.store == reports.id and request.role is StationRole.OPERATOR:
            reports.deliver(body.after)
        found = reports.after(after, min(max(body.most, 1), MOST_AT_ONCE))
        rows = [[e.number, int(e.severity), e.source, e.text, round(e.t_s, 2), e.cause] for e in found]
        return answer(request, result={"store": reports.id, "last": reports.last, "reports": rows})


def _doing(mission: MissionSummary) -> str:
    """Actions under way and their progress."""
    running = [target for target, state in mission.tasks.items() if "." in target and state == "running"]
    shares = {target: mission.progress.get(target, 0.0) for target in running}
    return ", ".join(f"{target} {share * 100:.0f} %" if share else target for target, share in shares.items())
