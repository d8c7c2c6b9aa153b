"""The vehicle in two lines, and the line above everything: who, how well, how well heard, who is in control."""

from gloc3.ci import Health
from gloc3_groundstation import wording
from gloc3_groundstation.snapshots import Fleet, PlatformSnapshot
from gloc3_groundstation.tui.lines import Line, Span, Tone, bar, faded, joined, spread

BATTERY_LOW_PERCENT = 30
BATTERY_CRITICAL_PERCENT = 15

HEALTH_TONES = {
    Health.WORKING: Tone.GOOD,
    Health.QUIET: Tone.BUSY,
    Health.STANDBY: Tone.WARN,
    Health.IDLE: Tone.WARN,
    Health.ABSENT: Tone.BAD,
    Health.FAULTY: Tone.BAD,
}


def title_line(
    fleet: Fleet, platform: PlatformSnapshot | None, station: str, start_s: float, now_s: float, width: int
) -> Line:
    """Name, health, link and control of the platform in view, and the time since the station's start."""
    clock = (Span(f"station {station}  ", Tone.DIM), Span(wording.clock(now_s - start_s), Tone.DIM), Span(" "))
    if platform is None:
        return spread((Span(" GLOC3", Tone.STRONG), Span("  ground station", Tone.DIM)), clock, width)
    number = list(fleet.platforms).index(platform.name) + 1
    count = f" {number}/{len(fleet.platforms)}" if len(fleet.platforms) > 1 else ""
    parts = [Span(f" {platform.name}{count}", Tone.STRONG)]
    if platform.summary is None:
        parts.append(Span("health unknown", Tone.STALE))
    elif platform.summary.is_stale(now_s):
        parts.append(Span(f"was {platform.summary.value.health}", Tone.STALE))
    else:
        health = platform.summary.value.health
        parts.append(Span(health, HEALTH_TONES[health]))
    silent = wording.silence(platform, now_s)
    parts.append(Span(silent, Tone.ALARM) if silent else Span("link ok", Tone.GOOD))
    if not silent and (arrives := wording.arrival(platform)):
        parts.append(Span(arrives, Tone.WARN))
    is_ours = platform.control is not None and platform.control.value.holder == station
    parts.append(Span(wording.holder(platform, station), Tone.TEXT if is_ours else Tone.WARN))
    return spread(joined(parts), clock, width)


def vehicle_lines(platform: PlatformSnapshot | None, now_s: float, waiting_for: str) -> list[Line]:
    """Two lines about the vehicle; without a platform what is waited for and what to do about it."""
    if platform is None:
        hint = "Is gloc3 onboard running, and does its link lead here?"
        return [(Span(f" Waiting for a platform on {waiting_for}."),), (Span(f" {hint}", Tone.DIM),)]
    if platform.vehicle is None:
        return [(Span(" Nothing is known of the vehicle yet.", Tone.DIM),), ()]
    vehicle = platform.vehicle.value
    first = [Span(vehicle.mode or "mode unknown", Tone.STRONG)]
    first.append(Span(wording.arming(vehicle), Tone.BUSY if vehicle.is_armed else Tone.TEXT))
    first.append(_battery(vehicle.battery_percent))
    if not vehicle.is_autopilot_connected:
        first.append(Span("NO AUTOPILOT", Tone.ALARM))
    if vehicle.has_pilot_control:
        first.append(Span("PILOT HAS CONTROL", Tone.ALARM))
    second = [Span(wording.position(vehicle), Tone.TEXT if vehicle.is_pose_valid else Tone.BAD)]
    second += [Span(f"{vehicle.speed_m_s:.1f} m/s"), Span(f"heading {vehicle.heading_deg % 360:03d}°")]
    if vehicle.frame:
        second.append(Span(f"frame {vehicle.frame}", Tone.DIM))
    lines = [(Span(" "), *joined(first)), (Span(" "), *joined(second))]
    if platform.vehicle.is_stale(now_s):
        age = wording.duration(platform.vehicle.age_s(now_s))
        lines[1] = (*lines[1], Span(f"   {age} ago"))
        return [faded(line) for line in lines]
    return lines


def _battery(percent: int) -> Span:
    if percent < 0:
        return Span("battery unknown", Tone.WARN)
    tone = Tone.TEXT if percent > BATTERY_LOW_PERCENT else Tone.WARN
    tone = tone if percent > BATTERY_CRITICAL_PERCENT else Tone.ALARM
    return Span(f"battery {bar(percent / 100.0, 8)} {percent} %", tone)
