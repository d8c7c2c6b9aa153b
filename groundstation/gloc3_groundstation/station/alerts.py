"""Alerts for the operator: active causes and warnings, each kept until acknowledged and over.

An active cause (a faulty component, an empty battery, a silent link) is an alert until it is over and acknowledged. A
warning sent by a platform is over immediately, and is removed when it is acknowledged. Warnings that follow from one
cause are consequences in its alert. An alert that gets worse, or has a new consequence, has to be acknowledged again.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

import msgspec
from msgspec.structs import replace

from gloc3.messages.envelope import Severity
from gloc3.messages.preflight import Verdict
from gloc3.messages.software import Software, compared
from gloc3.messages.summaries import Cause, Health, component_cause
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.snapshots import HEALTHS, Fleet, FleetEvent, PlatformSnapshot

BATTERY_LOW_PERCENT: Final = 30
BATTERY_CRITICAL_PERCENT: Final = 15
LOSS_BAD: Final = 0.5
"""Share of the status that is lost from which the link is worth an alert."""
SETTLE_S: Final = 5.0
"""Delay before the link and missing parts of a new or restarted platform are evaluated, s."""
ANSWERED_S: Final = 10.0
"""How long a refusal of the operator's request is shown, s."""
MOST_CONSEQUENCES: Final = 5
"""The last ones are kept."""
LABELS: Final = "event "
"""Prefix of the names of alerts from warnings."""
_WELL: Final = frozenset(n for n, health in enumerate(HEALTHS) if health not in (Health.FAULTY, Health.ABSENT))
"""States of a component that are no cause."""
CORRECTIONS_OLD_S: Final = 10.0
"""Age of RTK corrections from which a vehicle that uses them is worth an alert, s."""
KEPT: Final = 200
"""Alerts at most; the oldest that are over make room."""


class AlertCause(msgspec.Struct, frozen=True):
    """An active problem."""

    platform: str
    what: str
    """Names it among the platform's causes: `battery`, `component pose`."""
    severity: Severity
    text: str


class Alert(msgspec.Struct, frozen=True, kw_only=True):
    """One alert."""

    platform: str
    what: str
    severity: Severity
    text: str
    since_s: float
    """Start, on the station's clock."""
    last_s: float
    """Time of the last warning, or of the end of its cause; while the cause is active, its start."""
    is_over: bool = False
    """The cause is over."""
    is_acknowledged: bool = False
    count: int = 1
    """Number of occurrences."""
    consequences: tuple[str, ...] = ()
    """What followed from it, in a few words each, in order."""
    is_condition: bool = True
    """Whether it is or was an active cause; False while there are only warnings."""

    @property
    def key(self) -> tuple[str, str]:
        """Identity of the alert."""
        return self.platform, self.what

    @property
    def is_cleared(self) -> bool:
        """Whether it was a cause that is over; false for a warning, which is always over."""
        return self.is_over and self.is_condition

    @property
    def story(self) -> str:
        """Its text, and what followed from it."""
        return "; ".join([self.text, *self.consequences])


TWO_OF_ONE_NAME: Final = (
    "two platforms have this name: one is shown, and both obey; stop one, then give it another name (platform file) "
    "and system id (gloc3 onboard --system-id)"
)


class Alerts(msgspec.Struct, frozen=True):
    """All alerts of a fleet."""

    all: Mapping[tuple[str, str], Alert] = {}
    events_seen: int = 0
    """Number of the last event that was evaluated."""
    refusals_seen: int = 0
    """Number of the last refusal that the operator has dismissed."""

    @property
    def pending(self) -> list[Alert]:
        """Those not acknowledged: worst first, then the active ones, then the newest."""
        return _sorted(alert for alert in self.all.values() if not alert.is_acknowledged)

    @property
    def listed(self) -> list[Alert]:
        """All, those first that are not acknowledged, worst and then newest first."""
        return [*self.pending, *_sorted(alert for alert in self.all.values() if alert.is_acknowledged)]

    @property
    def worst(self) -> Severity | None:
        """The severity of the worst that is not acknowledged."""
        return min((alert.severity for alert in self.all.values() if not alert.is_acknowledged), default=None)

    def of(self, platform: str) -> list[Alert]:
        """Those of one platform, as `listed`."""
        return [alert for alert in self.listed if alert.platform == platform]


def update(alerts: Alerts, fleet: Fleet, now_s: float, further: Iterable[AlertCause] = ()) -> Alerts:
    """The alerts as the fleet is now; the same object where nothing has changed.

    Args:
        alerts: those that were.
        fleet: with the events since then.
        now_s: the station's time.
        further: active problems that plug-ins find.
    """
    found = dict(alerts.all)
    standing = {(cause.platform, cause.what): cause for cause in (*further, *causes(fleet, now_s))}
    for key, cause in standing.items():
        found[key] = _standing(found.get(key), cause, now_s)
    for event in fleet.events_after(alerts.events_seen):
        if event.severity > Severity.WARNING or is_answer(event):
            continue
        if (event.platform, component_cause(event.source)) not in standing:
            alert = _warned(found.get((event.platform, _what(event))), event)
            found[alert.key] = alert
    for key, alert in list(found.items()):
        if key in standing:
            continue
        if alert.is_acknowledged:
            del found[key]
        elif not alert.is_over:
            found[key] = replace(alert, is_over=True, last_s=now_s)
    if found == alerts.all and fleet.event_count == alerts.events_seen:
        return alerts
    return Alerts(_bounded(found), fleet.event_count, alerts.refusals_seen)


def acknowledge(alerts: Alerts, key: tuple[str, str] | None = None) -> Alerts:
    """The alerts after an operator has taken note of one, or (without a key) of all; those that are over go."""
    found = {}
    for name, alert in alerts.all.items():
        if key is None or name == key:
            if alert.is_over:
                continue
            alert = replace(alert, is_acknowledged=True)
        found[name] = alert
    return Alerts(found, alerts.events_seen, alerts.refusals_seen)


def dismiss(alerts: Alerts, refusal: FleetEvent) -> Alerts:
    """The alerts after an operator has taken note of a refusal, and so of those before it."""
    return replace(alerts, refusals_seen=refusal.number)


def began(alerts: Alerts, before: Alerts, what: str) -> list[Alert]:
    """Alerts of a kind whose cause was not active before."""
    found = [alert for alert in alerts.all.values() if alert.what == what and not alert.is_over]
    return [alert for alert in found if alert.key not in before.all or before.all[alert.key].is_over]


def causes(fleet: Fleet, now_s: float) -> Iterator[AlertCause]:
    """Active problems, platform by platform."""
    for platform in fleet:
        for problem in platform.problems:
            yield AlertCause(platform.name, problem.what, problem.severity, problem.text)
        if platform.is_doubled(now_s):
            yield AlertCause(platform.name, "name", Severity.ERROR, TWO_OF_ONE_NAME)
        if platform.is_quiet_link(now_s):
            if platform.is_silent_as_planned(now_s) or (not platform.is_known and platform.silence is None):
                continue
            text = _silence(
                is_flying=platform.is_armed, has_companion=platform.has_companion, is_overdue=platform.is_overdue(now_s)
            )
            yield AlertCause(
                platform.name, Cause.LINK, Severity.CRITICAL if platform.is_armed else Severity.ERROR, text
            )
            continue
        if platform.table is not None and platform.table.version:
            ends = compared("versions", Software(platform.table.version, platform.table.protocol), "onboard")
            if ends.verdict in (Verdict.WARNING, Verdict.RED):
                severity = Severity.ERROR if ends.verdict is Verdict.RED else Severity.WARNING
                yield AlertCause(platform.name, "versions", severity, f"versions differ: {ends.finding}; {ends.advice}")
        is_settled = now_s - platform.began_s >= SETTLE_S
        if is_settled and platform.link.loss >= LOSS_BAD:
            yield AlertCause(platform.name, "loss", Severity.WARNING, "more than half of its status messages are lost")
        yield from _vehicle_causes(platform, now_s, is_settled=is_settled)
        yield from _component_causes(platform, is_settled=is_settled)
        yield from _corrections_cause(platform, fleet, now_s)
        for encounter in fleet.encounters:
            if encounter.platform == platform.name and encounter.severity is not None:
                yield AlertCause(platform.name, f"traffic {encounter.key}", encounter.severity, f"traffic {encounter}")


def _corrections_cause(platform: PlatformSnapshot, fleet: Fleet, now_s: float) -> Iterator[AlertCause]:
    corrections, autopilot = fleet.corrections, platform.autopilot
    if corrections is None or autopilot is None or not (autopilot.is_alive and autopilot.has_used_rtk):
        return
    age_s = corrections.age_s(now_s)
    if age_s is None or age_s > CORRECTIONS_OLD_S:
        why = f": {corrections.problem}" if corrections.problem else ""
        text = f"no RTK corrections for more than {CORRECTIONS_OLD_S:.0f} s, its position becomes metre-level{why}"
        yield AlertCause(platform.name, "rtk", Severity.WARNING, text)


def _silence(*, is_flying: bool, has_companion: bool, is_overdue: bool) -> str:
    """Text for a silent vehicle: its behaviour meanwhile, and what to do."""
    if is_overdue:
        return "overdue: its planned silence is over, and it is not heard; it follows the mission's on_overdue"
    if not is_flying:
        return "no messages from it any more: is it switched on, and its link open (Fleet)?"
    policy = "it follows the mission's on_link_loss" if has_companion else "it follows its own failsafe"
    return f"no messages from it, and it was armed: {policy}; check radio, antenna and its link (Fleet)"


def _vehicle_causes(platform: PlatformSnapshot, now_s: float, *, is_settled: bool) -> Iterator[AlertCause]:
    if platform.vehicle is None or platform.vehicle.is_stale(now_s):
        return
    vehicle, name = platform.vehicle.value, platform.name
    if 0 <= vehicle.battery_percent <= BATTERY_LOW_PERCENT:
        is_critical = vehicle.battery_percent <= BATTERY_CRITICAL_PERCENT
        limit = BATTERY_CRITICAL_PERCENT if is_critical else BATTERY_LOW_PERCENT
        severity = Severity.CRITICAL if is_critical else Severity.WARNING
        yield AlertCause(name, Cause.BATTERY, severity, f"battery at or below {limit} %")
    if is_settled and not vehicle.is_autopilot_connected:
        text = "no autopilot: the companion receives nothing from it; check its cable, and gloc3 onboard --autopilot"
        yield AlertCause(name, Cause.AUTOPILOT, Severity.CRITICAL, text)
    if is_settled and vehicle.has_pilot_control:
        is_handed_back = not (vehicle.is_failsafe or vehicle.is_operators)
        advice = "when the vehicle is handed back" if is_handed_back else "to take it back"
        text = f"{wording.controller(vehicle)} has control; resume {advice}"
        yield AlertCause(name, Cause.FAILSAFE if vehicle.is_failsafe else Cause.PILOT, Severity.WARNING, text)
    if is_settled and vehicle.is_armed and not vehicle.is_pose_valid and platform.has_companion:
        yield AlertCause(name, Cause.POSITION, Severity.CRITICAL, "armed without a valid position")


def _component_causes(platform: PlatformSnapshot, *, is_settled: bool) -> Iterator[AlertCause]:
    if platform.table is None or all(line.state in _WELL for line, _ in platform.lines.values()):
        return  # as nearly always; this is looked at for every vehicle, several times a second
    for index, row in enumerate(platform.table.rows):
        line, _ = platform.lines.get(index, (None, 0.0))
        if line is None or line.state >= len(HEALTHS):
            continue
        health = HEALTHS[line.state]
        is_missing = health is Health.ABSENT and row.is_required and is_settled
        if health is not Health.FAULTY and not is_missing:
            continue
        problem = platform.troubles.get(row.name)
        cause = f": {problem.cause.strip().splitlines()[-1]}" if problem and problem.cause.strip() else ""
        severity = Severity.ERROR if row.is_required else Severity.WARNING
        yield AlertCause(platform.name, component_cause(row.name), severity, f"{row.name} is {health}{cause}")


def _standing(alert: Alert | None, cause: AlertCause, now_s: float) -> Alert:
    """Alert of an active cause; one that is new, has returned or got worse is not acknowledged."""
    if alert is not None and not alert.is_condition:
        return _confirmed(alert, cause)
    if alert is None or alert.is_over:
        count = alert.count + 1 if alert is not None else 1
        return Alert(
            platform=cause.platform,
            what=cause.what,
            severity=cause.severity,
            text=cause.text,
            since_s=now_s,
            last_s=now_s,
            count=count,
        )
    is_worse = cause.severity < alert.severity
    return replace(
        alert, severity=cause.severity, text=cause.text, is_acknowledged=alert.is_acknowledged and not is_worse
    )


def _confirmed(alert: Alert, cause: AlertCause) -> Alert:
    """Alert of a cause of which warnings came first."""
    own = alert.what == component_cause(alert.text.partition(":")[0])  # the component itself said that it is faulty
    first = () if own else (_briefly(alert.text.partition(": ")[2]),)
    return replace(
        alert,
        severity=min(alert.severity, cause.severity),
        text=cause.text,
        consequences=_bounded_words((*first, *alert.consequences)),
        is_over=False,
        is_condition=True,
    )


def _warned(alert: Alert | None, event: FleetEvent) -> Alert:
    """Alert of a warning that was received, perhaps repeatedly, or as the consequence of another one."""
    text = f"{event.source}: {event.text}" if event.source else event.text
    if alert is None or (text == alert.text and alert.is_over):
        return Alert(
            platform=event.platform,
            what=_what(event),
            severity=event.severity,
            text=text,
            since_s=alert.since_s if alert else event.received_s,
            last_s=event.received_s,
            is_over=True,
            count=alert.count + 1 if alert else 1,
            is_condition=False,
        )
    brief = _briefly(event.text)
    is_known = brief in alert.consequences
    return replace(
        alert,
        severity=min(alert.severity, event.severity),
        last_s=event.received_s if alert.is_over else alert.last_s,
        consequences=alert.consequences if is_known else _bounded_words((*alert.consequences, brief)),
        is_acknowledged=alert.is_acknowledged and is_known,
    )


def _briefly(text: str) -> str:
    """`policy hold` of `policy hold: sweep failed: ...`: the rest is in the alert already."""
    return text.partition(": ")[0]


def _bounded_words(consequences: tuple[str, ...]) -> tuple[str, ...]:
    return consequences[-MOST_CONSEQUENCES:]


def _what(event: FleetEvent) -> str:
    return event.cause or f"{LABELS}{event.source}: {event.text}"


def is_answer(event: FleetEvent) -> bool:
    """Whether it is only the refusal of a request by this station's operator."""
    return not event.source and event.severity is Severity.ERROR


def answer(alerts: Alerts, fleet: Fleet, now_s: float) -> FleetEvent | None:
    """The refusal that the operator has to be shown now; None where there was none lately, or it was dismissed."""
    for event in reversed(fleet.events):
        if now_s - event.received_s >= ANSWERED_S or event.number <= alerts.refusals_seen:
            return None
        if is_answer(event):
            return event
    return None


def _sorted(alerts: Iterable[Alert]) -> list[Alert]:
    return sorted(alerts, key=lambda alert: (alert.severity, alert.is_cleared, -alert.last_s))


def _bounded(found: dict[tuple[str, str], Alert]) -> dict[tuple[str, str], Alert]:
    surplus = len(found) - KEPT
    if surplus > 0:
        over = sorted((alert for alert in found.values() if alert.is_over), key=lambda alert: alert.last_s)
        for alert in over[:surplus]:
            del found[alert.key]
    return found
