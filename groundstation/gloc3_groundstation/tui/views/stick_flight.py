"""Manual flight by sticks as lines: whether the autopilot takes them, what is sent, and what the vehicle does."""

from typing import Final, NamedTuple

from gloc3_groundstation.joysticks.device import StickDemand
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.tui.views.joystick import bar
from gloc3_groundstation.tui.views.teleoperation import REPORTED_S, link_line
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone, wrapped

WIDTH: Final = 58
NOT_HEARD_S: Final = 3.0


class StickFlightView(NamedTuple):
    """The station's side."""

    is_open: bool
    """Sticks are sent."""
    takes_sticks: bool
    """In a mode that takes them."""
    is_kept: bool
    """The dead-man's key is."""
    sticks: StickDemand
    note: str = ""
    """What is not kept with released sticks in this mode."""
    warnings: tuple[str, ...] = ()
    problem: str = ""
    """Why it has ended."""


def stick_flight_lines(
    platform: PlatformSnapshot | None, shown: StickFlightView, round_trip_s: float | None, now_s: float
) -> tuple[Line, ...]:
    """State, link, sticks, motion, and what the vehicle's parameters say of sticks."""
    mode = wording.mode(platform) if platform is not None else ""
    rows: list[Line] = [_state_line(platform, shown, mode, now_s), link_line(platform, round_trip_s, now_s), EMPTY]
    for name, stick in zip(("surge", "sway", "heave", "turn"), shown.sticks, strict=True):
        shown_bar = bar(stick)
        sent = f"{stick * 100.0:>+5.0f}%" if shown.takes_sticks and shown.is_kept else f"{'centred':>6}"
        line = (
            f"{name:<8}{shown_bar}{stick * 100.0:>+6.0f}%   sent {sent}" if shown.is_open else f"{name:<8}{shown_bar}"
        )
        rows.append((Span(line, Tone.TEXT if stick else Tone.DIM),))
    rows += [EMPTY, _motion_line(platform, now_s)]
    texts = [(shown.problem, Tone.BAD), (shown.note, Tone.WARN)]
    texts += [(text, Tone.BAD if "IGNORES" in text else Tone.WARN) for text in shown.warnings]
    return (*rows, *((Span(line, tone),) for text, tone in texts if text for line in wrapped(text, WIDTH)))


def _state_line(platform: PlatformSnapshot | None, shown: StickFlightView, mode: str, now_s: float) -> Line:
    age_s = platform.vehicle.age_s(now_s) if platform is not None and platform.vehicle is not None else None
    if age_s is None or age_s >= NOT_HEARD_S:
        return (Span("NOT HEARD", Tone.ALARM), Span("  centred sticks are sent" if shown.is_open else "", Tone.WARN))
    if not shown.is_open:
        return (Span("NOT BEGUN", Tone.STRONG), Span(f"  mode {mode}; enter takes the sticks", Tone.DIM))
    if not shown.takes_sticks:
        return (Span("HOLDING", Tone.WARN), Span(f"  mode {mode} takes no sticks; enter sets one", Tone.DIM))
    if shown.is_kept:
        return (Span("LIVE", Tone.GOOD), Span(f"  {mode}", Tone.TEXT))
    return (Span("AT REST", Tone.WARN), Span(f"  {mode}; hold the dead-man's key to move", Tone.DIM))


def _motion_line(platform: PlatformSnapshot | None, now_s: float) -> Line:
    timed = platform.vehicle if platform is not None else None
    if timed is None:
        return (Span("its state is not known", Tone.DIM),)
    state = timed.value
    armed = "ARMED" if state.is_armed else "disarmed"
    height_m = state.position_m[2]
    what = f"depth {-height_m:.1f} m" if height_m < -0.05 else f"height {height_m:.1f} m"
    text = f"{armed}   {what}   {state.speed_m_s:.1f} m/s   heading {wording.bearing(state.heading_deg)}"
    return (Span(text, Tone.STALE if timed.age_s(now_s) > REPORTED_S * 3.0 else Tone.STRONG),)
