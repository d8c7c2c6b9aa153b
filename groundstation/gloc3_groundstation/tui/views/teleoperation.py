"""Teleoperation as lines: whether it is live, and requested, wanted and measured speeds."""

from math import inf
from typing import Final, NamedTuple

from gloc3.messages.teleoperation import EXPIRES_S, TeleoperationState
from gloc3_groundstation.desk.teleoperation import FullSpeed
from gloc3_groundstation.joysticks.device import StickDemand
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone

REPORTED_S: Final = 1.0
"""Age from which the vehicle's report is ignored, s: it is sent five times a second."""

NOTHING: Final = f"{'–':>10}"


class TeleoperationView(NamedTuple):
    """The station's side."""

    is_begun: bool
    is_kept: bool
    """The dead-man's key is."""
    sticks: StickDemand
    full: FullSpeed
    session: int


def state_line(platform: PlatformSnapshot | None, helm: TeleoperationView, now_s: float) -> Line:
    """The state in a few words: whether the vehicle follows now."""
    reported = _reported(platform, now_s)
    if not helm.is_begun:
        return (Span("NOT BEGUN", Tone.STRONG), Span("  enter requests teleoperation", Tone.DIM))
    if reported is None:
        return (Span("NOT HEARD", Tone.ALARM), Span(f"  it stops {EXPIRES_S:g} s after the last demand", Tone.DIM))
    is_ours = reported.session == helm.session
    if reported.is_live and is_ours:
        note = "released" if not helm.is_kept else reported.reason
        return (Span("LIVE", Tone.GOOD), Span(f"  {note}" if note else "", Tone.WARN if reported.reason else Tone.DIM))
    if helm.is_kept:
        who = "" if is_ours or reported.session == 0 else ": it follows another session"
        return (Span("NOT FOLLOWED", Tone.ALARM), Span(f"  {reported.reason or 'it does not follow'}{who}", Tone.WARN))
    return (Span("AT REST", Tone.WARN), Span("  hold enter to move", Tone.DIM))


def helm_lines(
    platform: PlatformSnapshot | None, helm: TeleoperationView, round_trip_s: float | None, now_s: float
) -> tuple[Line, ...]:
    """State, link, the four axes, depth and heading."""
    reported = _reported(platform, now_s)
    wanted = (*reported.velocity_cm_s, reported.yaw_rate_cdeg_s) if reported is not None else None
    measured = (*reported.measured_cm_s, reported.measured_yaw_rate_cdeg_s) if reported is not None else None
    full = (helm.full.across_m_s, helm.full.across_m_s, helm.full.up_m_s, helm.full.turn_deg_s)
    rows: list[Line] = [
        state_line(platform, helm, now_s),
        link_line(platform, round_trip_s, now_s),
        EMPTY,
        (Span(f"{'':<8}{'sticks':>8}{'asked':>10}{'wanted':>10}{'measured':>10}", Tone.DIM),),
    ]
    for index, (name, unit) in enumerate((("surge", "m/s"), ("sway", "m/s"), ("heave", "m/s"), ("turn", "°/s"))):
        stick = helm.sticks[index]
        requested = f"{stick * full[index]:>+10.2f}" if helm.is_begun and helm.is_kept else NOTHING
        line = f"{name:<8}{stick * 100.0:>+7.0f}%{requested}"
        line += f"{_number(wanted, index)}{_number(measured, index)}  {unit}"
        rows.append((Span(line, Tone.TEXT if stick else Tone.DIM),))
    rows += [EMPTY, _place_line(platform, now_s)]
    return tuple(rows)


def _reported(platform: PlatformSnapshot | None, now_s: float) -> TeleoperationState | None:
    reported = platform.teleoperation if platform is not None else None
    return reported.value if reported is not None and reported.age_s(now_s) < REPORTED_S else None


def _number(values: tuple[int, ...] | None, index: int) -> str:
    return NOTHING if values is None else f"{values[index] / 100.0:>+10.2f}"


def link_line(platform: PlatformSnapshot | None, round_trip_s: float | None, now_s: float) -> Line:
    """Age of the link and its round-trip time."""
    age_s = platform.age_s(now_s) if platform is not None else inf
    text = "never heard" if age_s == inf else f"heard {age_s:.1f} s ago"
    if round_trip_s is not None:
        text += f", round trip {round_trip_s * 1000.0:.0f} ms"
    return (Span(f"link: {text}", Tone.BAD if age_s > REPORTED_S else Tone.DIM),)


def _place_line(platform: PlatformSnapshot | None, now_s: float) -> Line:
    """Depth below the frame's origin, or height above it, and heading."""
    motion = platform.motion if platform is not None else None
    if motion is None:
        return (Span("depth and heading are not known", Tone.DIM),)
    height_m = motion.value.position_cm[2] / 100.0
    what = f"depth {-height_m:.2f} m" if height_m < -0.05 else f"height {height_m:.2f} m"
    heading = motion.value.attitude_cdeg[2] / 100.0 % 360.0
    return (
        Span(f"{what}   heading {wording.bearing(heading)}", Tone.STALE if motion.is_stale(now_s) else Tone.STRONG),
    )
