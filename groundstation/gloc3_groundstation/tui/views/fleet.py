"""The fleet as lines: vehicles with marks, control of the one in view, and links with their traffic."""

from collections.abc import Container, Sequence
from typing import Final

from gloc3.cli.counting import counted
from gloc3.cli.port_advice import port_advice
from gloc3.messages.command_interface import ControlVerb
from gloc3.messages.summaries import WELL, VehicleLine
from gloc3.network.rights import MEANINGS, MemberRights
from gloc3.network.rights_file import Right
from gloc3_groundstation.links.link_snapshot import LinkSnapshot
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.regions import is_silent
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.overview import link_span, mission_cells, vehicle_cells, vehicle_table, worst_span
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone, cut, wrapped
from gloc3_groundstation.tui.widgets.tables import Column, table_of

COLUMNS: Final = (
    Column("", 3),
    Column("vehicle", 10, grows=1, most=20),
    Column("mode", 9, rank=2),
    Column("state", 13, grows=1, most=16),
    Column("bat", 5, is_right=True),
    Column("link", 12),
    Column("mission", 8, grows=1, most=20),
    Column("progress", 15, rank=3),
    Column("control", 13, rank=3),
    Column("components", 16, rank=1, grows=2, most=36),
)
REGION_STALE_S: Final = 5.0
"""Older summaries of a region are stale, s."""
LINK_COLUMNS: Final = (
    Column("link", 28, grows=1, most=44),
    Column("in B/s", 8, is_right=True),
    Column("out B/s", 8, is_right=True, rank=2),
    Column("frames in", 10, is_right=True, rank=3),
    Column("frames out", 10, is_right=True, rank=3),
    Column("dropped", 7, is_right=True, rank=1),
    Column("behind it", 20, grows=4),
)


def fleet_header(view: StationView, width: int) -> Line:
    """The titles of the columns."""
    return vehicle_table(COLUMNS, view, width).header()


def fleet_line(view: StationView, platform: PlatformSnapshot, marked: Container[str], width: int) -> Line:
    """One vehicle; `●` where it is marked."""
    is_in_view = view.platform is not None and platform.name == view.platform.name
    mark = ("►" if is_in_view else " ") + (" ●" if platform.name in marked else "  ")
    tone = Tone.STRONG if is_in_view else Tone.TEXT
    return vehicle_table(COLUMNS, view, width).line(
        [
            Span(mark, Tone.BUSY),
            Span(platform.name, tone),
            *vehicle_cells(platform, view.now_s),
            link_span(platform, view.now_s),
            *mission_cells(platform, view.now_s),
            _control(view, platform),
            worst_span(platform, view.now_s, is_brief=True),
        ]
    )


def unwatched_lines(view: StationView, width: int) -> list[Line]:
    """Vehicles that are known by the summaries of their regions only."""
    table = vehicle_table(COLUMNS, view, width)
    return [
        table.line([Span(text, tone) for text, tone in _unwatched_cells(router, view.now_s - received_s, vehicle)])
        for router, received_s, vehicle in view.fleet.elsewhere()
    ]


def _unwatched_cells(router: str, late_s: float, vehicle: VehicleLine) -> list[tuple[str, Tone]]:
    is_stale = late_s > REGION_STALE_S or is_silent(vehicle)
    tone = Tone.STALE if is_stale else Tone.DIM
    battery = f"{vehicle.battery_percent} %" if vehicle.battery_percent >= 0 else "–"
    landed = vehicle.landed.replace("_", " ")
    health = Tone.BAD if vehicle.health not in WELL and not is_stale else tone
    return [
        ("", tone),
        (vehicle.name, tone),
        (wording.summed_up_mode(vehicle), tone),
        (f"armed, {landed}" if vehicle.is_armed else "disarmed" if vehicle.landed else "", tone),
        (battery, tone),
        (f"by {router}", tone),
        (vehicle.mission_state, tone),
        (vehicle.mission, tone),
        (f"station {vehicle.holder}" if vehicle.holder else "", tone),
        ("silent" if is_silent(vehicle) else vehicle.health, health),
    ]


def fleet_title(view: StationView, marked: Sequence[str]) -> str:
    """Number of vehicles, and the receivers of orders."""
    count = counted(len(view.fleet.platforms), "vehicle")
    if marked:
        return f"{count}: commands go to {', '.join(marked)}"
    return f"{count}: commands go to {view.platform.name}" if view.platform is not None else count


def control_lines(view: StationView, possible: Container[ControlVerb], width: int) -> list[Line]:
    """Holder of control of the selected vehicle, a pending request, possible actions, and what the station may do."""
    platform = view.platform
    if platform is None:
        return []
    if platform.control is None:
        return [(Span(" It is not known who is in control.", Tone.STALE),)]
    requester = platform.control.value.requested_by
    stale = Tone.STALE if platform.control.is_stale(view.now_s) else None
    held = f" {wording.holder(platform, view.station)}"
    spans = [Span(held, stale or (Tone.GOOD if view.is_in_control else Tone.WARN))]
    if requester:
        whose = "this station has requested it" if requester == view.station else f"station {requester} requests it"
        spans.append(Span(f"; {whose}", stale or Tone.WARN))
    keys = [
        (key, label)
        for verb, key, label in (
            (ControlVerb.GRANT, "g", "grant"),
            (ControlVerb.REFUSE, "f", "refuse"),
            (ControlVerb.REQUEST, "c", "request"),
            (ControlVerb.TAKE_OVER, "t", "take over"),
            (ControlVerb.RELEASE, "z", "release"),
        )
        if verb in possible
    ]
    hints = [part for key, label in keys for part in (Span(f"   {key}", Tone.KEY), Span(f" {label}", Tone.DIM))]
    return [tuple(spans), tuple(hints), *_rights_lines(platform.rights, width)]


def _rights_lines(rights: MemberRights, width: int) -> list[Line]:
    """What this station may do, and why not more; nothing where there are no rights."""
    if not rights.roles:
        return []
    two = [MEANINGS[Right(name)] for name in rights.two_persons]
    second = f"; two persons: {', '.join(two)}" if two else ""
    texts = [(f"This station is {wording.roles(rights)}{second}", Tone.TEXT)]
    texts += [(refusal, Tone.DIM) for refusal in rights.refusals.values()]
    return [(Span(f" {line}", tone),) for text, tone in texts for line in wrapped(text, width - 1)]


def link_header(width: int) -> Line:
    """The titles of the columns."""
    return table_of(LINK_COLUMNS, width).header()


def link_lines(link: LinkSnapshot, width: int) -> list[Line]:
    """One link, and what to do if it is not open."""
    is_lost = bool(link.problem) and not link.is_connected
    advice = [(Span(cut(f"   → {port_advice(link.problem)}", width), Tone.DIM),)] if is_lost else []
    return [link_line(link, width), *advice]


def link_line(link: LinkSnapshot, width: int) -> Line:
    """One link."""
    is_lost = bool(link.problem) and not link.is_connected
    behind = (
        link.forwards
        or ", ".join((*link.platforms, *link.received))
        or ("no system heard" if link.is_connected else "none yet")
    )
    tone = Tone.WARN if link.refusals else Tone.TEXT if link.platforms or link.received else Tone.DIM
    if remark := link.note():
        behind = f"{remark}; {behind}" if link.refusals else f"{behind}; {remark}"
    problem = link.problem.removeprefix(f"{link.url.partition('://')[2]}: ")
    return table_of(LINK_COLUMNS, width).line(
        [
            Span(link.url, Tone.BAD if is_lost else Tone.TEXT),
            Span(rate(link.bytes_in_s), Tone.TEXT if link.bytes_in_s else Tone.STALE),
            Span(rate(link.bytes_out_s), Tone.TEXT),
            Span(f"{link.frames_in:,}", Tone.DIM),
            Span(f"{link.frames_out:,}", Tone.DIM),
            Span(f"{link.dropped:,}" if link.dropped else "·", Tone.WARN if link.dropped else Tone.DIM),
            Span(problem, Tone.BAD) if is_lost else Span(behind, tone),
        ]
    )


def rate(bytes_s: float) -> str:
    """`840`, `12.5 k`, `1.2 M`."""
    for limit, unit in ((1e6, " M"), (1e4, " k")):
        if bytes_s >= limit:
            return f"{bytes_s / (1e6 if limit == 1e6 else 1e3):.1f}{unit}"
    return f"{bytes_s:.0f}"


def _control(view: StationView, platform: PlatformSnapshot) -> Span:
    if platform.control is None:
        return Span("?", Tone.STALE)
    state = platform.control.value
    if state.requested_by:
        return Span(f"{state.requested_by} asks", Tone.WARN)
    if state.holder == view.station:
        return Span("here", Tone.GOOD)
    return Span(f"station {state.holder}" if state.holder else "nobody", Tone.DIM)
