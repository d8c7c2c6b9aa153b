"""The frame of every screen: the vehicle in view, tabs, the current alert, and the keys."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from gloc3.messages.envelope import Severity
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.alerts import BATTERY_CRITICAL_PERCENT, BATTERY_LOW_PERCENT
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone, cut, fitted, joined, spread, text_of

BATTERY_RANK: Final = 3
"""Rank of the battery in the title; lower ranks are dropped after it, the time of day before it."""
GAP: Final = "   "
SPACIOUS: Final = 100
"""Width from which the screens' names are separated from their keys."""


class Key(NamedTuple):
    """A key and its action."""

    key: str
    """As a person reads it: `space`, `^p`."""
    label: str
    is_enabled: bool = True
    is_always_shown: bool = False


class Tab(NamedTuple):
    """A screen in the line of screens."""

    key: str
    title: str
    is_shown: bool


def title_line(view: StationView, width: int) -> Line:
    """The vehicle in view: mode, armed, battery, link and control; the alerts of all vehicles; the time."""
    clock: Line = (Span(f"  {wording.clock(view.now_s - view.started_s)} ", Tone.DIM),)
    alerts = _alerts(view)
    if view.platform is None:
        name: Line = (Span(" GLOC3", Tone.STRONG), Span(f"   station {view.station}", Tone.DIM))
        if view.fleet.platforms:
            name = (*name, Span("   no vehicle in view: v shows one", Tone.WARN))
        return spread(name, (*alerts, *clock), width)
    platform = view.platform
    count = f" {view.number}/{len(view.fleet.platforms)}" if len(view.fleet.platforms) > 1 else ""
    parts: list[tuple[int, Span]] = [(0, Span(f" {platform.name}{count}", Tone.STRONG))]
    if platform.vehicle is None:
        parts.append((1, Span("state unknown", Tone.STALE)))
    else:
        vehicle = platform.vehicle.value
        is_stale = platform.vehicle.is_stale(view.now_s)
        was = "was " if is_stale else ""
        parts.append((2, _span(f"{was}{wording.mode(platform) or 'mode unknown'}", Tone.TEXT, is_stale)))
        armed = "ARMED" if vehicle.is_armed else wording.armed(vehicle)
        parts.append((1, _span(armed, Tone.BUSY if vehicle.is_armed else Tone.DIM, is_stale)))
        parts.append((BATTERY_RANK, _span(*battery(vehicle.battery_percent), is_stale)))
    parts.append((1, link(view)))
    held = control(view)
    parts.append((1 if held.tone is Tone.WARN and view.is_in_control else 4, held))
    room = width - len(text_of((*alerts, *clock))) - 2
    needed = len(text_of(joined([span for rank, span in parts if rank <= BATTERY_RANK], GAP)))
    if room < needed <= room + len(text_of(clock)):
        clock, room = (), room + len(text_of(clock))
    return spread(fitted(parts, room, GAP), (*alerts, *clock), width)


def battery(percent: int) -> tuple[str, Tone]:
    """`bat 97 %`."""
    if percent < 0:
        return "bat ?", Tone.WARN
    tone = Tone.TEXT if percent > BATTERY_LOW_PERCENT else Tone.WARN
    return f"bat {percent} %", tone if percent > BATTERY_CRITICAL_PERCENT else Tone.ALARM


def link(view: StationView) -> Span:
    """`link ok`, `link 12 % lost`, or for how long nothing has come."""
    platform = view.platform
    if platform is None:
        return Span("no link", Tone.STALE)
    planned = platform.silence
    if planned is not None and platform.is_silent_as_planned(view.now_s):
        return Span(f"silent as planned, due {planned.due_text}", Tone.WARN)
    if planned is not None and platform.is_overdue(view.now_s):
        return Span(f"OVERDUE {wording.duration(view.now_s - planned.due_s)}", Tone.ALARM)
    if not platform.is_known:
        return Span("acoustic only", Tone.WARN)
    if platform.is_quiet_link(view.now_s):
        return Span(f"SILENT {wording.duration(platform.age_s(view.now_s))}", Tone.ALARM)
    if platform.link.loss >= wording.REPORTED_LOSS:
        return Span(f"link {platform.link.loss * 100.0:.0f} % lost", Tone.WARN)
    return Span("link ok", Tone.GOOD)


def control(view: StationView) -> Span:
    """Who is in control of the vehicle in view, in a word or two."""
    holder = view.platform.control.value.holder if view.platform is not None and view.platform.control else None
    requester = view.platform.control.value.requested_by if view.platform is not None and view.platform.control else ""
    if requester and view.is_in_control:
        return Span(f"{requester} requests control", Tone.WARN)
    if view.is_in_control:
        return Span("in control", Tone.TEXT)
    if view.platform is not None and not view.platform.has_companion:
        return Span("autopilot only", Tone.DIM)
    if holder is None:
        return Span("control ?", Tone.STALE)
    return Span(f"{holder} controls" if holder else "watching", Tone.WARN if holder else Tone.DIM)


def tone_of(severity: Severity) -> Tone:
    """Tone of a severity."""
    if severity <= Severity.CRITICAL:
        return Tone.ALARM
    if severity is Severity.ERROR:
        return Tone.BAD
    if severity is Severity.WARNING:
        return Tone.WARN
    return Tone.TEXT if severity is Severity.NOTICE else Tone.DIM


def tabs_line(tabs: Sequence[Tab], width: int) -> Line:
    """The screens with their keys; the current one is highlighted."""
    between, gap = _tab_gaps(width)
    spans = [Span(" ")]
    for tab in tabs:
        if tab.is_shown:
            spans.append(Span(f"{tab.key}{between}{tab.title}", Tone.CHOSEN))
        else:
            spans += [Span(f"{tab.key}{between}", Tone.BUSY), Span(tab.title, Tone.DIM)]
        spans.append(Span(gap))
    return tuple(spans)


def tab_at(tabs: Sequence[Tab], width: int, column: int) -> Tab | None:
    """The screen at a column of that line."""
    between, gap = _tab_gaps(width)
    begin = 1
    for tab in tabs:
        end = begin + len(tab.key) + len(between) + len(tab.title)
        if begin <= column < end:
            return tab
        begin = end + len(gap)
    return None


def alert_line(view: StationView, width: int) -> Line:
    """Reason of a recent refusal, else the worst alert that is not acknowledged; empty without either."""
    refusal = view.refusal
    if refusal is not None:
        whose = f"{refusal.platform}: " if refusal.platform else ""
        return (Span(cut(f" ✗ {whose}{' '.join(refusal.text.split())}", width), Tone.BAD),)
    pending = view.alerts.pending
    if not pending:
        return EMPTY
    alert, others = pending[0], f"  +{len(pending) - 1} more" if len(pending) > 1 else ""
    who = f"{alert.platform}: " if alert.platform else ""
    over = f", over since {wording.clock(alert.last_s - view.started_s)}" if alert.is_cleared else ""
    text = f" {alert.severity.name.lower()}{over}: {who}{' '.join(alert.story.split())}"
    tails = (f"{others}   x acknowledges ", f"{others} ")  # the key stands in the last line too
    tail = next((tail for tail in tails if len(text) + len(tail) + 2 <= width), tails[-1])
    return spread((Span(cut(text, width - len(tail) - 2), tone_of(alert.severity)),), (Span(tail, Tone.DIM),), width)


def keys_line(keys: Sequence[Key], width: int) -> Line:
    """The keys that fit: first those that are always shown, then the others in their order."""
    spans = [Span(" ")]
    for key in _fitting(keys, width):
        spans.append(Span(key.key, Tone.KEY if key.is_enabled else Tone.DIM))
        spans.append(Span(f" {key.label}  ", Tone.TEXT if key.is_enabled else Tone.DIM))
    return tuple(spans)


def key_at(keys: Sequence[Key], width: int, column: int) -> Key | None:
    """The key at a column of that line."""
    begin = 1
    for key in _fitting(keys, width):
        if begin <= column < begin + _width(key) - 2:
            return key
        begin += _width(key)
    return None


def too_small_lines(width: int, height: int, needed: tuple[int, int], *, is_web: bool = False) -> list[Line]:
    """What is the matter with a small terminal, and what still works."""
    advice = "reload the page to fit its font." if is_web else "enlarge it."
    return [
        (Span(f"This terminal has {width} × {height} characters.", Tone.WARN),),
        (Span(f"The station needs {needed[0]} × {needed[1]}: {advice}"),),
        (Span("space makes the vehicle hold, q quits.", Tone.DIM),),
    ]


def _alerts(view: StationView) -> Line:
    pending, worst = view.alerts.pending, view.alerts.worst
    if worst is None:
        return (Span(f"{len(view.alerts.all)} known" if view.alerts.all else "", Tone.DIM),)
    return (Span(f" ▲ {len(pending)} alert{'s' if len(pending) > 1 else ''} ", tone_of(worst)),)


def _span(text: str, tone: Tone, is_stale: bool) -> Span:
    return Span(text, Tone.STALE if is_stale else tone)


def _fitting(keys: Sequence[Key], width: int) -> list[Key]:
    """Keys for which there is room, in their order."""
    always = [key for key in keys if key.is_always_shown]
    room = width - 1 - sum(_width(key) for key in always)
    if sum(_width(key) for key in keys) > width - 1:
        keys = [key for key in keys if key.is_enabled]
    shown = []
    for key in keys:
        if key.is_always_shown:
            continue
        room -= _width(key)
        if room < 0:
            break
        shown.append(key)
    return [*shown, *always]


def _tab_gaps(width: int) -> tuple[str, str]:
    """Text between a screen's key and its name, and between two screens."""
    return (" ", "  ") if width >= SPACIOUS else ("", " ")


def _width(key: Key) -> int:
    return len(key.key) + len(key.label) + 3
