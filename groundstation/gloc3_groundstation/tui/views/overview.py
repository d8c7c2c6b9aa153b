"""The fleet at a glance: a line for each vehicle, details of the one in view, and the alerts."""

from collections.abc import Iterable, Sequence
from typing import Final

from gloc3.clock import utc_text
from gloc3.messages.summaries import Health, VehicleSummary
from gloc3.mission.model.states import ActionState
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.snapshots import PlatformSnapshot, Timed
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.chain import SIGNS
from gloc3_groundstation.tui.views.chrome import battery, tone_of
from gloc3_groundstation.tui.views.components import HEALTH_TONES
from gloc3_groundstation.tui.views.corrections import correction_rows
from gloc3_groundstation.tui.views.mission.traffic import traffic_tone
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone, bar, cut, wrapped
from gloc3_groundstation.tui.widgets.tables import Column, FittedTable, table_of, with_names

COLUMNS: Final = (
    Column("", 1),
    Column("vehicle", 10, grows=1, most=20),
    Column("mode", 9),
    Column("state", 16),
    Column("battery", 8, is_right=True),
    Column("link", 12),
    Column("mission", 9, grows=2, most=20),
    Column("progress", 15, rank=2),
    Column("position", 24, rank=3),
    Column("gps", 26, rank=4),
    Column("power", 13, rank=6),
    Column("flight", 17, rank=5),
    Column("components", 20, rank=1, grows=2, most=36),
    Column("alerts", 6, is_right=True, rank=1),
)
BAR_WIDTH: Final = 9
GOOD_PERCENT: Final = 50
"""Position quality below which it is highlighted."""
NARROW_ALERTS: Final = 60
"""Columns below which an alert's severity has no column of its own."""
SEVERITY: Final = 9
FACT_WIDTH: Final = 26
"""Columns for a long fact, which goes on in the next line."""
MOST_TRAFFIC: Final = 3
"""Lines of traffic."""
TWO_COLUMNS: Final = 76
"""Columns from which the details stand side by side."""
ABSENT: Final = "–"
"""In the place of what was never received."""
READINGS: Final = ("charge", "estimator", "vibration", "rc", "radio")
"""Readings below the other details."""
SLOW_TRIP_S: Final = 1.0
"""Round trip from which the operator is warned of delayed keys."""


def vehicle_table(columns: tuple[Column, ...], view: StationView, width: int) -> FittedTable:
    """A table with a line for each vehicle, of which the column of vehicles holds their names."""
    return table_of(with_names(columns, "vehicle", (platform.name for platform in view.fleet), width), width)


def vehicle_header(view: StationView, width: int) -> Line:
    """The titles of the columns."""
    return vehicle_table(COLUMNS, view, width).header()


def vehicle_line(view: StationView, platform: PlatformSnapshot, width: int) -> Line:
    """One vehicle."""
    is_in_view = view.platform is not None and platform.name == view.platform.name
    now_s = view.now_s
    cells = [
        Span("►" if is_in_view else " ", Tone.BUSY),
        Span(platform.name, Tone.STRONG if is_in_view else Tone.TEXT),
        *vehicle_cells(platform, now_s),
        link_span(platform, now_s),
        *mission_cells(platform, now_s),
        _position(platform, now_s),
        reading_span(platform, "gps", now_s),
        reading_span(platform, "power", now_s),
        flight_span(platform),
        worst_span(platform, now_s),
        _alerts(view, platform),
    ]
    return vehicle_table(COLUMNS, view, width).line(cells)


def waiting_lines(view: StationView) -> list[Line]:
    """What the station waits for, and what to do about it."""
    hints = ("Is gloc3 onboard running, and does its link lead here?", "--link udpin://0.0.0.0:14550 hears a network.")
    if view.fleet.platforms:
        return [EMPTY, (Span(" The selected vehicle is not heard; v shows another one."),)]
    waiting = (Span(f" Waiting for a platform on {view.waiting_for}."),)
    return [EMPTY, waiting, *((Span(f" {hint}", Tone.DIM),) for hint in hints)]


def detail_lines(view: StationView, width: int = 38) -> list[Line]:
    """What is worth knowing of the vehicle in view, a fact a line, the most important first; wide, in two columns."""
    if width < TWO_COLUMNS:
        return _wrapped(_facts(view), width)
    each = (width - 1) // 2
    facts = _wrapped(_facts(view), each - 1)
    half = (len(facts) + 1) // 2
    right = [*facts[half:], EMPTY][:half]
    return [(*_padded(line, each), *other) for line, other in zip(facts[:half], right, strict=True)]


def _wrapped(facts: Iterable[Line], width: int) -> list[Line]:
    """The same in lines that have room: what is long goes on in the next line."""
    lines: list[Line] = []
    for name, span in facts:
        room = width - len(name.text)
        texts = [span.text] if len(span.text) <= room else wrapped(span.text, room)
        blank = Span(" " * len(name.text))
        lines += [(blank if number else name, Span(text, span.tone)) for number, text in enumerate(texts)]
    return lines


def _padded(line: Line, width: int) -> Line:
    name, span = line
    text = cut(span.text, width - len(name.text) - 1)
    return (name, Span(f"{text:<{width - len(name.text)}}", span.tone))


def _facts(view: StationView) -> list[Line]:
    platform = view.platform
    if platform is None:
        return []
    now_s = view.now_s
    snapshot: list[tuple[str, Span]] = [
        ("control", _control(view, platform)),
        ("link", link_detail(view, platform)),
        *_silence_figures(platform, now_s),
        ("health", worst_span(platform, now_s)),
    ]
    timed = platform.vehicle
    if timed is None:
        snapshot.append(("vehicle", Span("no data yet", Tone.STALE)))
    else:
        vehicle = timed.value
        stale = Tone.STALE if timed.is_stale(now_s) else None
        motion = f"{vehicle.speed_m_s:.1f} m/s, heading {wording.bearing(vehicle.heading_deg)}"
        snapshot += [
            (
                "position",
                Span(wording.position(vehicle), stale or (Tone.TEXT if vehicle.is_pose_valid else Tone.BAD)),
            ),
            ("motion", Span(motion, stale or Tone.TEXT)),
            ("battery", _battery_bar(platform, vehicle.battery_percent, stale, now_s)),
            ("gps", reading_span(platform, "gps", now_s)),
            ("flight", _flight(platform, now_s)),
            ("from", _source(vehicle, stale)),
            ("mode", Span(wording.mode_detail(platform) or ABSENT, stale or Tone.TEXT)),
        ]
        if not vehicle.is_autopilot_connected:
            snapshot.insert(0, ("autopilot", Span("NOT CONNECTED", stale or Tone.BAD)))
        if vehicle.has_pilot_control:
            who = "failsafe" if vehicle.is_failsafe else "operator" if vehicle.is_operators else "pilot"
            snapshot.insert(0, (who, Span("HAS CONTROL", stale or Tone.BAD)))
        if vehicle.frame:
            snapshot.append(("frame", Span(vehicle.frame, stale or Tone.TEXT)))
    snapshot += [(name[:10], Span(text)) for name, text in view.further]
    near = [one for one in view.fleet.encounters if one.platform == platform.name][:MOST_TRAFFIC]
    traffic = [("" if number else "traffic", Span(str(one), traffic_tone(one))) for number, one in enumerate(near)]
    for name, span in (*correction_rows(view), *traffic):
        first, *more = wrapped(span.text, FACT_WIDTH)
        snapshot += [(name, Span(first, span.tone)), *(("", Span(text, span.tone)) for text in more)]
    snapshot += [(name, reading_span(platform, name, now_s)) for name in READINGS]
    snapshot.append(("utc", Span(utc_text(now_s + view.fleet.utc_offset_s, "%H:%M:%S"), Tone.TEXT)))
    return [(Span(f" {name:<10}", Tone.DIM), span) for name, span in snapshot]


def detail_title(view: StationView) -> str:
    """Name of the selected vehicle, and the age of its state where it is stale."""
    platform = view.platform
    if platform is None:
        return ""
    timed = platform.vehicle
    if timed is None or not timed.is_stale(view.now_s):
        return platform.name
    return f"{platform.name}, {wording.duration(timed.age_s(view.now_s))} ago"


def alert_lines(view: StationView, width: int) -> list[Line]:
    """Alerts of all vehicles, those not acknowledged first."""
    lines: list[Line] = []
    for alert in view.alerts.listed:
        tone = Tone.DIM if alert.is_acknowledged else tone_of(alert.severity)
        sign = "✓" if alert.is_acknowledged else "▲"
        who = f"{alert.platform}: " if alert.platform and len(view.fleet.platforms) > 1 else ""
        times = f" ({alert.count} times)" if alert.count > 1 else ""
        times += f" (over since {wording.clock(alert.last_s - view.started_s)})" if alert.is_cleared else ""
        head = f" {sign} {wording.clock(alert.since_s - view.started_s)}  "
        name = alert.severity.name.lower()
        rest = Tone.DIM if alert.is_acknowledged else Tone.TEXT
        text = f"{who}{alert.story}{times}"
        if width < NARROW_ALERTS:  # the severity stands before the text, which goes on below it
            first, *more = wrapped(f"{name}: {text}", width - len(head))
            lines.append((Span(head, Tone.DIM), Span(name, tone), Span(first[len(name) :], rest)))
            blank = len(head)
        else:
            blank = len(head) + SEVERITY + 2
            first, *more = wrapped(text, width - blank)
            lines.append(
                (Span(head, Tone.DIM), Span(name, tone), Span(" " * (SEVERITY + 2 - len(name))), Span(first, rest))
            )
        lines += [(Span(" " * blank), Span(row, rest)) for row in more]
    if not lines and view.platform is not None:
        return [(Span(" Nothing is wrong.", Tone.GOOD),)]
    return lines


def alerts_title(view: StationView) -> str:
    """How many are to be acknowledged."""
    pending = len(view.alerts.pending)
    if pending:
        return f"alerts: {pending} to acknowledge"
    return f"alerts: {len(view.alerts.all)} known" if view.alerts.all else "alerts"


def link_span(platform: PlatformSnapshot, now_s: float) -> Span:
    """`ok`, `12 % lost`, or the duration of the silence."""
    if platform.silence is not None and platform.is_silent_as_planned(now_s):
        return Span(f"due {platform.silence.due_text.removesuffix(' UTC')}", Tone.WARN)
    if platform.is_overdue(now_s):
        return Span("OVERDUE", Tone.BAD)
    if not platform.is_known:
        return Span("acoustic", Tone.WARN)
    if platform.is_quiet_link(now_s):
        return Span(f"silent {wording.roughly(platform.age_s(now_s))}", Tone.BAD)
    if platform.link.loss >= wording.REPORTED_LOSS:
        return Span(f"{platform.link.loss * 100.0:.0f} % lost", Tone.WARN)
    return Span("ok", Tone.GOOD)


def link_detail(view: StationView, platform: PlatformSnapshot) -> Span:
    """`98 % arrives, 320 ms there and back`, or the duration of the silence."""
    planned = platform.silence
    if planned is not None and platform.is_silent_as_planned(view.now_s):
        return Span(f"silent as planned ({planned.target})", Tone.WARN)
    if planned is not None and platform.is_overdue(view.now_s):
        return Span(f"OVERDUE by {wording.duration(view.now_s - planned.due_s)}", Tone.BAD)
    if not platform.is_known:
        return Span("acoustic messages only", Tone.WARN)
    if platform.is_quiet_link(view.now_s):
        return Span(f"silent for {wording.duration(platform.age_s(view.now_s))}", Tone.BAD)
    loss, trip_s = platform.link.loss, view.round_trip_s
    is_slow = trip_s is not None and trip_s >= SLOW_TRIP_S
    trip = f", {trip_s * 1000.0:.0f} ms round" if trip_s is not None else ""
    tone = Tone.WARN if loss >= wording.REPORTED_LOSS or is_slow else Tone.TEXT
    return Span(f"{(1.0 - loss) * 100.0:.0f} % arrives{trip}", tone)


def _silence_figures(platform: PlatformSnapshot, now_s: float) -> list[tuple[str, Span]]:
    """When contact is due, and the last acoustic report."""
    snapshot = []
    planned = platform.silence
    if planned is not None and platform.is_quiet_link(now_s):
        left_s = planned.due_s - now_s
        when = f", in {wording.roughly(left_s)}" if left_s > 0.0 else ""
        snapshot.append(("due", Span(f"{planned.due_text}{when}", Tone.WARN if left_s > 0.0 else Tone.BAD)))
    reported = wording.received_by_sound(platform) if platform.is_quiet_link(now_s) else []
    if platform.acoustic is not None and reported:
        place, doing, *more = reported
        snapshot += [
            ("acoustic", Span(place, Tone.TEXT)),
            ("", Span(f"{wording.roughly(platform.acoustic.age_s(now_s))} ago: {doing}", Tone.TEXT)),
            *([("", Span(", ".join(more), Tone.TEXT))] if more else []),
        ]
    return snapshot


def worst_span(platform: PlatformSnapshot, now_s: float, *, is_brief: bool = False) -> Span:
    """The worst component, or that all are healthy; in brief form with a sign for its state."""
    if platform.is_all_well(now_s):
        return Span(f"all {len(platform.lines)} well", Tone.GOOD)
    components = platform.components(now_s)
    if not platform.has_companion:
        return Span("no companion", Tone.DIM)
    if not components:
        return Span("not known yet", Tone.STALE)
    if all(component.is_stale for component in components):
        return Span("as last heard", Tone.STALE)
    order = list(Health)
    unhealthy = [component for component in components if not component.is_well and component.health is not None]
    if not unhealthy:
        return Span(f"all {len(components)} well", Tone.GOOD)
    worst = max(unhealthy, key=lambda component: order.index(component.health or Health.WORKING))
    text = f"{SIGNS[worst.health]} {worst.name}" if is_brief else f"{worst.name} {worst.health}"
    more = f" +{len(unhealthy) - 1}" if len(unhealthy) > 1 else ""
    return Span(f"{text}{more}", HEALTH_TONES[worst.health or Health.WORKING])


def vehicle_cells(platform: PlatformSnapshot, now_s: float) -> Sequence[Span]:
    """Mode, state and battery."""
    if platform.vehicle is None:
        return Span("?", Tone.STALE), Span("not known yet", Tone.STALE), Span("?", Tone.STALE)
    vehicle = platform.vehicle.value
    level, tone = _battery(vehicle.battery_percent)
    mode = Span(wording.mode(platform) or "?")
    state = Span(_state(vehicle), Tone.BUSY if vehicle.is_armed else Tone.DIM)
    return _aged((mode, state, Span(level, tone)), platform.vehicle, now_s)


def _state(vehicle: VehicleSummary) -> str:
    if not vehicle.is_armed and vehicle.landed == "on_ground":
        return "disarmed"
    return wording.arming(vehicle)


def mission_cells(platform: PlatformSnapshot, now_s: float) -> Sequence[Span]:
    """The mission's state and progress."""
    if platform.mission is None or not platform.mission.value.state:
        return Span("none", Tone.DIM), Span("")
    mission = platform.mission.value
    policy = f", {mission.policy}" if mission.policy else ""
    tones = {ActionState.RUNNING: Tone.BUSY, ActionState.DONE: Tone.GOOD, ActionState.WAITING: Tone.DIM}
    tone = tones.get(ActionState(mission.state), Tone.WARN) if mission.state in list(ActionState) else Tone.WARN
    actions = [item for item in wording.items(mission) if not item.is_task]
    over = sum(item.state in (ActionState.DONE, ActionState.SKIPPED) for item in actions)
    share = (over + sum(mission.progress.values())) / max(1, len(actions))
    progress = f"{bar(share, BAR_WIDTH)} {min(1.0, share) * 100.0:3.0f} %"
    return _aged((Span(f"{mission.state}{policy}", tone), Span(progress, tone)), platform.mission, now_s)


def _position(platform: PlatformSnapshot, now_s: float) -> Span:
    if platform.vehicle is None:
        return Span("")
    vehicle = platform.vehicle.value
    span = Span(wording.position(vehicle), Tone.TEXT if vehicle.is_pose_valid else Tone.BAD)
    return _aged((span,), platform.vehicle, now_s)[0]


def _alerts(view: StationView, platform: PlatformSnapshot) -> Span:
    alerts = [alert for alert in view.alerts.all.values() if alert.platform == platform.name]
    pending = [alert for alert in alerts if not alert.is_acknowledged]
    if pending:
        tone = tone_of(min(alert.severity for alert in pending))
        return Span(f"▲ {len(pending)}", Tone.BAD if tone is Tone.ALARM else tone)
    return Span(f"✓ {len(alerts)}" if alerts else "none", Tone.DIM)


def _control(view: StationView, platform: PlatformSnapshot) -> Span:
    requester, held = "", wording.holder(platform, view.station)
    if platform.control is not None:
        requester = platform.control.value.requested_by
    text = f"{'here' if view.is_in_control else 'elsewhere'}; station {requester} asks" if requester else held
    if platform.is_quiet_link(view.now_s):
        return Span(text, Tone.STALE)
    return Span(text, Tone.TEXT if view.is_in_control and not requester else Tone.WARN)


def _source(vehicle: VehicleSummary, stale: Tone | None) -> Span:
    """Sources of the position, and its quality."""
    quality = vehicle.pose_quality_percent
    tone = Tone.TEXT if vehicle.is_pose_valid and quality >= GOOD_PERCENT else Tone.WARN if quality > 0 else Tone.BAD
    if quality < 0:
        return Span("not reported", stale or Tone.DIM)
    return Span(f"{' + '.join(vehicle.pose_sources) or 'nothing'}, quality {quality} %", stale or tone)


def _battery(percent: int) -> tuple[str, Tone]:
    """The same as above, less prominent: the alarm is in the title."""
    level, tone = battery(percent)
    return level.removeprefix("bat "), Tone.BAD if tone is Tone.ALARM else tone


def _battery_bar(platform: PlatformSnapshot, percent: int, stale: Tone | None, now_s: float) -> Span:
    level, tone = _battery(percent)
    volts = _volts(platform, now_s)
    if percent < 0:
        return Span(f"not known{volts}", stale or Tone.WARN)
    return Span(f"{bar(percent / 100.0, 5 if volts else 12)} {level}{volts}", stale or tone)


def _volts(platform: PlatformSnapshot, now_s: float) -> str:
    """Voltage and current as the vehicle reports them; empty where it does not, or not lately."""
    power = None if platform.autopilot is None else platform.autopilot.readings.get("power")
    if power is not None and not power.is_stale(now_s):
        return f", {power.text}"
    motion = platform.motion
    if motion is None or motion.is_stale(now_s) or not motion.value.battery_cv:
        return ""
    return f", {motion.value.battery_cv / 100.0:.1f} V {motion.value.battery_ca / 100.0:.1f} A"


def reading_span(platform: PlatformSnapshot, name: str, now_s: float) -> Span:
    """A reading of the autopilot, with its age where it is stale; a dash where it was never received."""
    reading = None if platform.autopilot is None else platform.autopilot.readings.get(name)
    if reading is None:
        return Span(ABSENT, Tone.DIM)
    if reading.is_stale(now_s):
        return Span(f"{reading.text} ({wording.roughly(now_s - reading.received_s)} ago)", Tone.STALE)
    return Span(reading.text, (Tone.TEXT, Tone.WARN, Tone.BAD)[reading.level])


def flight_span(platform: PlatformSnapshot) -> Span:
    """Time in the air."""
    text = "" if platform.autopilot is None else platform.autopilot.flight
    return Span(text, Tone.TEXT) if text else Span(ABSENT, Tone.DIM)


def _flight(platform: PlatformSnapshot, now_s: float) -> Span:
    """Time in the air, and the distance to home."""
    flight, home = flight_span(platform), reading_span(platform, "home", now_s)
    if home.text == ABSENT:
        return flight
    return Span(f"{flight.text}, home {home.text}", home.tone)


def _aged(spans: Sequence[Span], timed: Timed, now_s: float) -> Sequence[Span]:  # type: ignore[type-arg] # of any message
    return [Span(span.text, Tone.STALE) for span in spans] if timed.is_stale(now_s) else spans
