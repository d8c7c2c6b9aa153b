"""RTK corrections in the details of a vehicle: rate, age, message types, and the distance of the base."""

from math import dist
from typing import Final

from gloc3.messages.frames import GeoPoint, ecef_from_geo
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.alerts import CORRECTIONS_OLD_S
from gloc3_groundstation.station.snapshots import CorrectionsSnapshot, PlatformSnapshot
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.widgets.lines import Span, Tone

FIXES: Final = {
    0: "fix not reported",
    1: "no fix",
    2: "2D fix",
    3: "3D fix",
    4: "DGPS",
    5: "RTK float",
    6: "RTK fixed",
    7: "static",
    8: "PPP",
}
"""GPS_FIX_TYPE."""


def correction_rows(view: StationView) -> list[tuple[str, Span]]:
    """Lines with their names; none where the station takes no corrections."""
    corrections, platform = view.fleet.corrections, view.platform
    if corrections is None or platform is None:
        return []
    age_s = corrections.age_s(view.now_s)
    if age_s is None:
        text, tone = corrections.problem or "no corrections yet", Tone.WARN
    else:
        is_old = age_s > CORRECTIONS_OLD_S
        age = wording.duration(age_s) if is_old else f"{age_s:.1f} s"
        text = f"{_fix(platform)}, {age}, {corrections.rate_byte_s:.0f} B/s"
        tone = Tone.BAD if is_old else Tone.TEXT
        if corrections.problem and is_old:
            text += f": {corrections.problem}"
    rows = [("rtk", Span(text, tone))]
    details = [*_base(corrections, platform), *_types(corrections), *_dropped(corrections)]
    rows += [("", Span(detail, Tone.DIM)) for detail in details]
    return rows


def _fix(platform: PlatformSnapshot) -> str:
    fix_type = 0 if platform.autopilot is None else platform.autopilot.fix_type
    return FIXES.get(fix_type, f"fix {fix_type}")


def _base(corrections: CorrectionsSnapshot, platform: PlatformSnapshot) -> list[str]:
    if corrections.base_ecef_m is None:
        return ["base position not told yet"] if corrections.types else []
    geo = platform.vehicle.value.geo if platform.vehicle is not None else None
    if geo is None:
        return ["base position known"]
    away_m = dist(ecef_from_geo(GeoPoint(*geo)), corrections.base_ecef_m)
    return [f"base {away_m:.0f} m away" if away_m < 1000.0 else f"base {away_m / 1000.0:.1f} km away"]


def _types(corrections: CorrectionsSnapshot) -> list[str]:
    return [f"RTCM {' '.join(map(str, corrections.types))}"] if corrections.types else []


def _dropped(corrections: CorrectionsSnapshot) -> list[str]:
    counts = {"damaged": corrections.damaged, "too long": corrections.oversized, "left out": corrections.left_out}
    words = [f"{count} {name}" for name, count in counts.items() if count]
    return [f"frames dropped: {', '.join(words)}"] if words else []
