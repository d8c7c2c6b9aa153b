"""Labels around the map: cursor position, vehicles with their colours, and the legend."""

from math import atan2, degrees, hypot

from gloc3_groundstation.station import wording
from gloc3_groundstation.tui.views.mission.map import Chart, own_place, position_of, tone_of_vehicle
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone


def cursor_line(chart: Chart, place: tuple[float, float], width: int) -> Line:
    """Where the cursor is: in the frame of the vehicle in view, on Earth, and as seen from the vehicle."""
    north, east = place
    ground, own = chart.ground, own_place(chart)
    decimals = 2 if chart.projection.m_per_dot < 0.05 else 1
    parts: list[Span] = [Span(" +", Tone.KEY)]
    if ground.frame or not ground.has_north:
        x, y = own.local(north, east)
        parts.append(Span(f"x {x + 0.0:.{decimals}f}  y {y + 0.0:.{decimals}f} m"))
    else:
        parts.append(Span(f"north {north + 0.0:.{decimals}f}  east {east + 0.0:.{decimals}f} m"))
    geo = ground.geo(north, east)
    if geo is not None:
        parts.append(Span(f"{geo.latitude_deg:.6f}°  {geo.longitude_deg:.6f}°", Tone.DIM))
    platform = chart.view.platform
    position = position_of(platform) if platform is not None else None
    if platform is not None and position is not None:
        here = own.point(position)
        away_m = hypot(north - here[0], east - here[1])
        bearing = f" {degrees(atan2(east - here[1], north - here[0])) % 360.0:03.0f}°" if ground.has_north else ""
        parts.append(Span(f"{away_m:.{decimals}f} m{bearing} from {platform.name}", Tone.DIM))
    while len(parts) > 2 and sum(len(part.text) + 3 for part in parts) > width:
        parts.pop()
    spans: list[Span] = []
    for number, part in enumerate(parts):
        spans += [Span(" " if number == 1 else "   "), part] if number else [part]
    return tuple(spans)


def map_title(chart: Chart) -> str:
    """What is on the map."""
    ground = chart.ground
    where = f"frame {ground.frame}" if ground.frame else "north up" if ground.has_north else "frame not known"
    if chart.request is None:
        return f"{where}, no mission"
    return f"{where}, {chart.request.name}{'' if chart.is_loaded else ' (not loaded)'}"


def vehicle_lines(chart: Chart) -> list[Line]:
    """The vehicles with their colours and where they are, those first that are on the map."""
    on_map = {platform.name: place for _, platform, place in chart.placed}
    lines: list[Line] = []
    for number, platform in enumerate(chart.view.fleet):
        is_in_view = chart.view.platform is not None and platform.name == chart.view.platform.name
        position, tone = position_of(platform), tone_of_vehicle(number)
        is_stale = platform.vehicle is None or platform.vehicle.is_stale(chart.view.now_s)
        lines.append((Span(" ► " if is_in_view else " ● ", tone), Span(platform.name, Tone.STRONG)))
        vehicle = platform.vehicle.value if platform.vehicle is not None else None
        if position is None or vehicle is None:
            lines.append((Span("   position unknown", Tone.BAD),))
        else:
            x, y, height = position
            text = f"   x {wording.tenths(x)}  y {wording.tenths(y)}  h {wording.tenths(height)} m"
            lines.append((Span(text, Tone.STALE if is_stale else Tone.TEXT),))
            motion = f"   {vehicle.speed_m_s:.1f} m/s, heading {vehicle.heading_deg % 360:03d}°"
            lines.append((Span(motion, Tone.STALE if is_stale else Tone.DIM),))
            if is_stale and platform.vehicle is not None:
                ago = wording.duration(platform.vehicle.age_s(chart.view.now_s))
                lines.append((Span(f"   that was {ago} ago", Tone.BAD),))
        if platform.name not in on_map:
            lines.append((Span("   not on this map", Tone.WARN),))
        lines.append(())
    return lines


def legend_lines(chart: Chart) -> list[Line]:
    """What the signs mean."""
    request = chart.request
    rows: list[tuple[str, Tone, str]] = []
    if request is not None and request.paths:
        rows += [("⠒⠒⠒", Tone.TEXT, "requested"), ("⠒ ⠒", Tone.DIM, "flown, or not yet loaded")]
    rows.append(("⠤⠤⠤", Tone.FIRST, "trail"))
    if request is not None and request.fence is not None:
        rows.append(("⠉⠒⠤", Tone.WARN, "fence"))
        if request.fence.keep_out:
            rows.append(("⢌⢢⢌", Tone.BAD, "keep out"))
    rows += [(" ⌂ ", Tone.GOOD, "home"), (" × ", Tone.STRONG, "setpoint"), ("⠊⠒⠑", Tone.DIM, "95 % sure")]
    return [(Span(f" {sign} ", tone), Span(text, Tone.DIM)) for sign, tone, text in rows]
