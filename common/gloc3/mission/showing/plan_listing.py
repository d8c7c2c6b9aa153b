"""Plans of other programs as text: their items by line, the fence and the rally points."""

from typing import Final

from gloc3.cli.counting import counted
from gloc3.mission.formats.commands import COMMANDS, command_name
from gloc3.mission.formats.items import FenceArea, ForeignPlan, MavItem

_REFERENCES: Final = {0: "sea", 5: "sea", 3: "home", 6: "home", 10: "ground", 11: "ground"}


def plan_listing(plan: ForeignPlan) -> str:
    """A plan, one line an item, with the line of its file."""
    lines = [] if plan.home is None else [f"home        {_place(*plan.home[:2])}  {plan.home[2]:g} m above sea"]
    for number, item in enumerate(plan.items, start=1):
        lines.append(f"item {number:<5}  {_item(item)}".rstrip() + _line(plan, number))
    lines += [f"fence       {_area(area)}" for area in plan.fence]
    if plan.fence_return is not None:
        lines.append(f"return to   {_place(*plan.fence_return)}")
    lines += [f"rally       {_place(lat, lon)}  {height:g} m above home" for lat, lon, height in plan.rally]
    return "\n".join(lines) + "\n"


def parts_summary(plan: ForeignPlan) -> str:
    """The fence and the rally points in a few words, as "1 fence area, 2 rally points"."""
    parts = [(len(plan.fence), "fence area"), (len(plan.rally), "rally point")]
    texts = [counted(count, name) for count, name in parts if count]
    return ", ".join(texts)


def _item(item: MavItem) -> str:
    known = COMMANDS.get(item.command)
    texts = [f"{command_name(item.command):<24}"]
    given: tuple[float | None, ...] = item.params
    if known is not None and known.has_position:
        texts.append(_place(item.x or 0.0, item.y or 0.0) if item.has_position else "here")
        texts.append(f"{item.z or 0.0:g} m above {_REFERENCES.get(item.frame, f'frame {item.frame}')}")
    else:
        given = (*item.params, item.x, item.y, item.z)
    texts += [f"param{number} {value:g}" for number, value in enumerate(given, start=1) if value]
    if not item.is_continued:
        texts.append("waits there")
    return "  ".join(texts)


def _line(plan: ForeignPlan, number: int) -> str:
    line = plan.line_of(number)
    return f"  (line {line})" if line else ""


def _place(latitude_deg: float, longitude_deg: float) -> str:
    return f"{latitude_deg:.7f}, {longitude_deg:.7f}"


def _area(area: FenceArea) -> str:
    side = "inside of" if area.is_inclusion else "outside of"
    if area.center is not None:
        return f"{side} {area.radius_m:g} m round {_place(*area.center)}"
    return f"{side} {counted(len(area.polygon), 'corner')}: " + "; ".join(_place(*corner) for corner in area.polygon)
