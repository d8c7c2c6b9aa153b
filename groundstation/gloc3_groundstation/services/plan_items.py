"""Converts plans between files and the wire: home, jumps and fences of either firmware; compares plans.

ArduPilot keeps home as item 0 of a mission, PX4 has none; files number the items as if home were item 0. A jump names
an item by number, so it moves with them.
"""

import math
from collections.abc import Sequence
from typing import Final

import msgspec

from gloc3.cli.counting import counted
from gloc3.mavlink.services.plan import PlanItem, PlanType
from gloc3.mission.formats.items import ForeignPlan, MavItem, PlanEntry, fence_parts, rally_points
from gloc3.plan_wire import from_wire as item_from_wire
from gloc3.plan_wire import jump_moved, mission_to_wire
from gloc3.plan_wire import to_wire as item_to_wire
from gloc3_groundstation.services.snapshot import Firmware

_SAME_FRAMES: Final = {5: 0, 6: 3, 11: 10}
"""Frames whose names end in INT have the same meaning as those without."""
_HEIGHT_STEP_M: Final = 0.011
"""ArduPilot keeps heights in centimetres."""
_PARAM_STEP: Final = 1e-4


class PlanParts(msgspec.Struct, frozen=True, kw_only=True):
    """A plan as it travels: the items of each transfer."""

    mission: tuple[PlanItem, ...] = ()
    fence: tuple[PlanItem, ...] = ()
    rally: tuple[PlanItem, ...] = ()

    def of(self, kind: PlanType) -> tuple[PlanItem, ...]:
        """The items of one transfer."""
        return (self.mission, self.fence, self.rally)[kind]


class PlanDifference(msgspec.Struct, frozen=True, kw_only=True):
    """A difference between the vehicle's plan and the wanted one."""

    kind: PlanType
    number: int
    """Number of the item, from 0 as on the wire."""
    text: str

    def __str__(self) -> str:
        return f"{self.kind.name.lower()} item {self.number}: {self.text}"


def to_wire(plan: ForeignPlan, firmware: Firmware) -> PlanParts:
    """A file's plan as the vehicle wants it.

    Raises:
        Refused: a number does not fit the wire; with the item.
    """
    has_home = firmware is Firmware.ARDUPILOT
    fence = plan if has_home else msgspec.structs.replace(plan, fence_return=None)  # a point that only ArduPilot knows
    return PlanParts(
        mission=mission_to_wire(plan.items, plan.home, has_home=has_home),
        fence=_items(fence.fence_items(), "fence item"),
        rally=_items(plan.rally_items(), "rally point"),
    )


def from_wire(parts: PlanParts, firmware: Firmware, vehicle_type: int = 2) -> ForeignPlan:
    """The vehicle's plan as a file has it.

    Raises:
        Refused: the fence or the rally points are not understood.
    """
    items = [item_from_wire(item) for item in parts.mission]
    home: tuple[float, float, float] | None = None
    if firmware is Firmware.ARDUPILOT and items:
        first = items.pop(0)
        home = (first.x or 0.0, first.y or 0.0, first.z or 0.0)
    elif firmware is not Firmware.ARDUPILOT:
        items = [jump_moved(item, 1) for item in items]
    fence = fence_parts([item_from_wire(item) for item in parts.fence])
    return ForeignPlan(
        entries=tuple(PlanEntry(items=(item,)) for item in items),
        fence=fence.areas,
        fence_return=fence.return_point,
        rally=rally_points([item_from_wire(item) for item in parts.rally]),
        home=home,
        firmware_type={Firmware.ARDUPILOT: 3, Firmware.PX4: 12}.get(firmware),
        vehicle_type=vehicle_type,
        raw={},
    )


def differences(
    wanted: Sequence[PlanItem], found: Sequence[PlanItem], kind: PlanType, firmware: Firmware
) -> tuple[PlanDifference, ...]:
    """What matters of the difference between two plans; home is the vehicle's own business."""
    rows: list[PlanDifference] = []
    if len(wanted) != len(found):
        rows.append(
            PlanDifference(kind=kind, number=0, text=f"{counted(len(wanted), 'item')} wanted, {len(found)} there")
        )
    for number, (left, right) in enumerate(zip(wanted, found, strict=False)):
        if number == 0 and kind is PlanType.MISSION and firmware is Firmware.ARDUPILOT:
            continue
        rows += [PlanDifference(kind=kind, number=number, text=text) for text in _item_differences(left, right)]
    return tuple(rows)


def _item_differences(wanted: PlanItem, found: PlanItem) -> list[str]:
    if wanted.command != found.command:
        return [f"command {wanted.command} is wanted, {found.command} is there"]
    texts = []
    if _frame(wanted) != _frame(found) and (wanted.x or wanted.y or wanted.z):
        texts.append(f"frame {wanted.frame} is wanted, {found.frame} is there")
    for name in ("param1", "param2", "param3", "param4"):
        left, right = getattr(wanted, name), getattr(found, name)
        if abs(_plain(left) - _plain(right)) > _PARAM_STEP * max(1.0, abs(_plain(left))):
            texts.append(f"{name} {left:g} is wanted, {right:g} is there")
    for name in ("x", "y"):
        left, right = getattr(wanted, name), getattr(found, name)
        if abs(left - right) > 1:
            texts.append(f"{name} {left} is wanted, {right} is there")
    if abs(_plain(wanted.z) - _plain(found.z)) > _HEIGHT_STEP_M:
        texts.append(f"height {wanted.z:g} m is wanted, {found.z:g} m is there")
    return texts


def _frame(item: PlanItem) -> int:
    return _SAME_FRAMES.get(item.frame, item.frame)


def _plain(value: float) -> float:
    """Value for comparison: a parameter that is not given counts as 0, because ArduPilot stores it so."""
    return 0.0 if math.isnan(value) else value


def _items(items: Sequence[MavItem], called: str) -> tuple[PlanItem, ...]:
    return tuple(item_to_wire(item, f"{called} {number}", is_current=number == 0) for number, item in enumerate(items))
