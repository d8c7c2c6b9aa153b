"""Plans on an autopilot, and the open one, as lines."""

from typing import Final

from gloc3.mission.formats.items import ForeignPlan, MavItem
from gloc3_groundstation.desk.plan_desk import PlanDesk, command_name
from gloc3_groundstation.services.plans import VehiclePlan
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone
from gloc3_groundstation.tui.widgets.tables import Column, FittedTable, table_of

COLUMNS: Final = (
    Column("", 2, is_right=True),
    Column("item", 20, grows=2, most=32),
    Column("x, latitude", 12, is_right=True),
    Column("y, longitude", 12, is_right=True),
    Column("height m", 8, is_right=True),
    Column("parameters", 13, rank=1, grows=1, most=40),
)


def plans_header(width: int) -> Line:
    """The titles of the columns."""
    return table_of(COLUMNS, width).header()


def plan_rows(desk: PlanDesk, width: int) -> list[tuple[str, Line]]:
    """Differences, the plan on the vehicle and the open plan; with keys for the cursor."""
    found: list[tuple[str, Line]] = []
    if desk.differences:
        found.append(("", (Span(" differences between the file and the vehicle", Tone.BAD),)))
        found += [(f"difference {n}", (Span(f"   {one}", Tone.WARN),)) for n, one in enumerate(desk.differences)]
        found.append(("", EMPTY))
    if desk.found is not None:
        found += _plan("on the vehicle", "vehicle", desk.found.plan, width)
    if desk.file is not None:
        if desk.found is not None:
            found.append(("", EMPTY))
        found += _plan(desk.file.name, "file", desk.file.plan, width)
    return found


def plans_title(desk: PlanDesk) -> str:
    """State of the vehicle's plan, and whether it equals the open one."""
    vehicle = "on the vehicle: not downloaded" if desk.found is None else f"on the vehicle: {desk.found.summary}"
    if desk.file is None:
        return vehicle
    if desk.differences is None:
        return f"{vehicle}; open: {desk.file.name}, not compared"
    return f"{vehicle}; {desk.file.name} is {'the same' if not desk.differences else 'NOT the same'}"


def _plan(title: str, key: str, plan: ForeignPlan, width: int) -> list[tuple[str, Line]]:
    heading = f" {title}: {VehiclePlan.summary_of(plan)}"
    rows: list[tuple[str, Line]] = [("", (Span(heading, Tone.STRONG),))]
    table = table_of(COLUMNS, width)
    for number, item in enumerate(plan.items):
        rows.append((f"{key} {number}", _item(table, number, item)))
    for number, area in enumerate(plan.fence):
        what = "stay inside" if area.is_inclusion else "stay outside"
        shape = f"circle {area.radius_m:g} m" if area.center is not None else f"{len(area.polygon)} corners"
        corner = area.center or (area.polygon[0] if area.polygon else (0.0, 0.0))
        rows.append((f"{key} fence {number}", _place(table, f"fence: {what}", corner, None, shape)))
    for number, (x, y, z) in enumerate(plan.rally):
        rows.append((f"{key} rally {number}", _place(table, "rally point", (x, y), z, "")))
    return rows


def _item(table: FittedTable, number: int, item: MavItem) -> Line:
    has_place = bool(item.x or item.y)
    params = " ".join("-" if param is None else f"{param:g}" for param in item.params)
    return table.line(
        [
            Span(str(number), Tone.DIM),
            Span(command_name(item.command)),
            Span(f"{item.x:.7f}" if has_place and item.x is not None else ""),
            Span(f"{item.y:.7f}" if has_place and item.y is not None else ""),
            Span("" if item.z is None or not (has_place or item.z) else f"{item.z:.1f}"),
            Span(params, Tone.DIM),
        ]
    )


def _place(table: FittedTable, what: str, place: tuple[float, float], height_m: float | None, note: str) -> Line:
    return table.line(
        [
            Span(""),
            Span(what),
            Span(f"{place[0]:.7f}"),
            Span(f"{place[1]:.7f}"),
            Span("" if height_m is None else f"{height_m:.1f}"),
            Span(note, Tone.DIM),
        ]
    )
