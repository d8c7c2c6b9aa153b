"""Start gate: the pre-flight checks, made on request from fresh readings."""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from gloc3.errors import Refused
from gloc3.messages.command_interface import CiReply, CiRequest, RequestAction, RequestTask, Steer
from gloc3.messages.preflight import Check, PreflightReport, red
from gloc3.messages.readiness import ReadSetup
from gloc3.messages.software import Software, own_software
from gloc3.messages.summaries import Health, health_of
from gloc3.mission.model.model import Mission
from gloc3.platform.platform import Platform
from gloc3_onboard.checks.checklist import checklist
from gloc3_onboard.checks.readings import ComponentCondition, Readings
from gloc3_onboard.command_server.observing import Observing

FIRST_READ_S: Final = 12.0
"""So long the first reading is waited for: PX4 does not answer for parameters that its version does not have."""
READ_S: Final = 3.0
"""Time for which a start waits for the autopilot's setup and for a late pose, s; then earlier readings count."""

Begin = Callable[[float], CiReply]
"""Carries out the request at a time; raises `Refused` if it cannot."""


class HeldRequest(NamedTuple):
    """A request that waits for the reading."""

    request: CiRequest
    answer: Begin
    number: int
    until_s: float


class RedChecks(Refused):
    """Refuses a start because checks are red."""

    def __init__(self, checks: list[Check]) -> None:
        several = f"{len(checks)} checks are red" if len(checks) > 1 else "a check is red"
        super().__init__(f"{several}: {'; '.join(f'{one.title} ({one.finding})' for one in checks)}")
        self.lines: Final = "\n".join(str(one) for one in checks)
        self.may_settle: Final = all(one.may_settle for one in checks)


class StartGate:
    """Makes the list, and admits or refuses starts."""

    def __init__(self, platform: Platform, observing: Observing) -> None:
        self._platform, self._observing = platform, observing
        self._outgoing: list[ReadSetup | PreflightReport] = []
        self._held: list[HeldRequest] = []
        self._number = 0

    def collect(self) -> list[ReadSetup | PreflightReport]:
        """Pending messages: requests to read the setup, and the finished lists for the log."""
        used, self._outgoing = self._outgoing, []
        return used

    def answer(self, request: CiRequest, answer: Begin, now_s: float) -> CiReply | None:
        """Reads the setup again, then answers; immediately without a reader, and None if the answer comes later."""
        setup = self._observing.setup
        if setup is None or not self._observing.snapshot.is_connected:
            return answer(now_s)
        self._number = max(self._number, setup.number) + 1
        self._outgoing.append(ReadSetup(number=self._number))
        wait_s = READ_S if setup.is_complete else FIRST_READ_S
        self._held.append(HeldRequest(request, answer, self._number, now_s + wait_s))
        return None

    @property
    def waiting(self) -> list[CiRequest]:
        """Requests that wait for the reading."""
        return [held.request for held in self._held]

    def due(self, now_s: float) -> list[HeldRequest]:
        """The requests that need wait no longer."""
        if not self._held:
            return []
        setup = self._observing.setup
        number = setup.number if setup is not None else 0
        is_late = self._observing.snapshot.is_pose_late(now_s)
        ready = [held for held in self._held if (number >= held.number and not is_late) or now_s >= held.until_s]
        self._held = [held for held in self._held if held not in ready]
        return ready

    def report(
        self, mission: Mission | None, fence_problem: str, stations: Mapping[str, Software], now_s: float
    ) -> PreflightReport:
        """The list as it is now.

        Args:
            mission: the loaded one.
            fence_problem: why the autopilot does not hold its fence; empty if it does.
            stations: the software of those that are there.
            now_s: the time.
        """
        checks = checklist(self._readings(mission, fence_problem, stations, now_s))
        computer = self._observing.computer
        offset_s = computer.utc_minus_t_s if computer is not None else None
        utc_s = None if offset_s is None else round(offset_s + now_s, 1)
        report = PreflightReport(checks=checks, utc_s=utc_s, **own_software()._asdict())
        self._outgoing.append(report)
        return report

    def let_through(self, request: CiRequest, report: PreflightReport) -> str:
        """Decides on a start by the list.

        Returns:
            Remarks to report after the start; empty if all checks pass.

        Raises:
            RedChecks: a check is red and has not been overridden.
        """
        bad, body = red(report.checks), request.body
        if not bad:
            return ""
        override = body.override.strip() if isinstance(body, Steer | RequestTask | RequestAction) else ""
        if not override:
            raise RedChecks(bad)
        author = getattr(body, "author", "").strip()
        who = f"{author} (station {request.sender})" if author else f"station {request.sender}"
        titles = "; ".join(f"{one.title} ({one.finding})" for one in bad)
        return f"{who} starts despite red checks: {override!r}; red: {titles}"

    def _readings(
        self, mission: Mission | None, fence_problem: str, stations: Mapping[str, Software], now_s: float
    ) -> Readings:
        known = self._observing
        snapshot, driver, setup = known.snapshot, known.snapshot.driver, known.setup
        has_pilot = driver is not None and driver.has_pilot_control
        return Readings(
            platform=self._platform,
            now_s=now_s,
            autopilot=snapshot.known_autopilot,
            setup=setup,
            is_setup_fresh=setup is None or setup.number >= self._number,
            computer=known.computer,
            pose=snapshot.pose,
            is_pose_fresh=snapshot.is_pose_fresh(now_s),
            height=known.height,
            components=self._conditions(now_s),
            mission=mission,
            home_ned_m=snapshot.home_ned_m,
            stations=stations,
            hosts=known.hosts,
            fence_problem=fence_problem,
            pilot_reason=(driver.pilot_reason or "it gives no reason") if driver is not None and has_pilot else "",
        )

    def _conditions(self, now_s: float) -> list[ComponentCondition]:
        found, book = [], self._observing.book
        for name, row in book.rows.items():
            status = book.status(name)
            health = health_of(book.state(name, now_s))
            cause = status.cause if status is not None and health not in ("working", "quiet") else ""
            found.append(
                ComponentCondition(
                    name=name,
                    health=health,
                    is_required=row.required,
                    is_standby=row.standby_for is not None,
                    cause=cause,
                    substitute=self._substitute(name, now_s) if health == Health.QUIET else "",
                )
            )
        return found

    def _substitute(self, name: str, now_s: float) -> str:
        """The working standby that is in charge in a component's place; empty where there is none."""
        supervision = self._observing.supervision
        charge = name if supervision is None else supervision.in_charge(name)
        return charge if charge != name and self._observing.book.is_working(charge, now_s) else ""
