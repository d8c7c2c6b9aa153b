"""QGroundControl's `.plan` files, read as MAVLink items and written; entries read from a file are written unchanged."""

import json
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from gloc3.documents.document import Where
from gloc3.errors import Finding, InputError
from gloc3.mission.formats.items import FenceArea, ForeignPlan, MavItem, PlanEntry
from gloc3.mission.formats.plan_source import SAVE_AGAIN, PlanSource, is_number, is_whole, number, whole

EXPANDABLE: Final = {"survey": (3, 4, 5), "CorridorScan": (2, 3)}
"""Complex items that contain their expanded items, with the supported versions."""

_OWN_KEYS: Final = ("items", "plannedHomePosition", "cruiseSpeed", "hoverSpeed", "firmwareType", "vehicleType")


def read_plan(data: bytes | str, file: str) -> ForeignPlan:
    """Reads a `.plan` file.

    Raises:
        InputError: it is none, or of a version or with items that cannot be read; each with a reason.
    """
    return _Reader(PlanSource(data, file)).plan()


class _Entry(NamedTuple):
    """An entry that was read, and the place of each of its items in the file."""

    read: PlanEntry
    places: tuple[Where, ...]


class _Reader:
    """Reads one file and collects its errors."""

    def __init__(self, source: PlanSource) -> None:
        self._source = source

    def plan(self) -> ForeignPlan:
        value = self._source.value
        if not isinstance(value, dict) or value.get("fileType") != "Plan":
            self._source.refuse(
                ("fileType",), "not a plan file: fileType is not 'Plan'", "choose a .plan of QGroundControl"
            )
        if value.get("version") != 1:
            self._source.refuse(
                ("version",), f"plan file version {value.get('version')!r} is not supported, only 1", SAVE_AGAIN
            )
        mission = value.get("mission")
        if not isinstance(mission, dict):
            return self._parts_alone(value)
        if mission.get("version") != 2:
            message = f"mission version {mission.get('version')!r} is not supported, only 2"
            self._source.refuse(("mission", "version"), message, SAVE_AGAIN)
        items = mission.get("items")
        if not isinstance(items, list):
            self._source.refuse(("mission",), "the mission has no list of items", SAVE_AGAIN)
        entries = [self._entry(item, ("mission", "items", index)) for index, item in enumerate(items)]
        fence, rally = self._fence(value.get("geoFence")), self._rally(value.get("rallyPoints"))
        lines = [self._source.line(where) for entry in entries if entry is not None for where in entry.places]
        home, warnings = self._home(mission.get("plannedHomePosition"))
        plan = ForeignPlan(
            entries=tuple(entry.read for entry in entries if entry is not None),
            fence=fence,
            fence_return=self._return_point(value.get("geoFence")),
            rally=rally,
            home=home,
            cruise_speed_m_s=number(mission, "cruiseSpeed"),
            hover_speed_m_s=number(mission, "hoverSpeed"),
            firmware_type=whole(mission, "firmwareType"),
            vehicle_type=whole(mission, "vehicleType"),
            raw=_without_own(value),
            lines=tuple(lines),
            findings=tuple(warnings),
        )
        if self._source.findings:
            raise InputError(sorted(self._source.findings))
        return plan

    def _home(self, value: Any) -> tuple[tuple[float, float, float] | None, list[Finding]]:
        """The planned home, and a warning where QGroundControl did not know its altitude, which it writes as null."""
        where = ("mission", "plannedHomePosition")
        if isinstance(value, list) and len(value) == 3 and value[2] is None:
            message = "the planned home has no altitude, and is left out"
            hint = "open the plan in QGroundControl, move home a little, and save it again"
            return None, [self._source.warning(where, message, hint)]
        home = self._source.numbers(value, 3, where, is_optional=True)
        return (home[0], home[1], home[2]) if home else None, []

    def _parts_alone(self, value: dict[str, Any]) -> ForeignPlan:
        """A fence or rally points without a mission."""
        fence, rally = self._fence(value.get("geoFence")), self._rally(value.get("rallyPoints"))
        if not (fence or rally or self._source.findings):
            self._source.refuse((), "there is no mission in it", "plan a mission in QGroundControl and save it again")
        if self._source.findings:
            raise InputError(sorted(self._source.findings))
        return_point = self._return_point(value.get("geoFence"))
        return ForeignPlan(fence=fence, fence_return=return_point, rally=rally, raw=_without_own(value))

    def _return_point(self, fence: Any) -> tuple[float, float] | None:
        point = fence.get("breachReturn") if isinstance(fence, dict) else None
        if not isinstance(point, list) or len(point) < 2 or not all(is_number(one) for one in point[:2]):
            return None
        return float(point[0]), float(point[1])

    def _entry(self, item: Any, where: Where) -> "_Entry | None":
        number = int(where[-1]) + 1
        if not isinstance(item, dict):
            self._source.find(where, f"item {number} is not a mapping", SAVE_AGAIN)
            return None
        if item.get("type") == "SimpleItem":
            simple = self._item(item, where)
            return _Entry(PlanEntry(items=(simple,), raw=item), (where,)) if simple is not None else None
        if item.get("type") != "ComplexItem":
            self._source.find(where, f"item {number} is of the unknown type {item.get('type')!r}", SAVE_AGAIN)
            return None
        return self._complex(item, where, number)

    def _complex(self, item: dict[str, Any], where: Where, number: int) -> "_Entry | None":
        kind, version = item.get("complexItemType"), item.get("version")
        versions = EXPANDABLE.get(kind) if isinstance(kind, str) else None
        if versions is None:
            hint = "replace it by a survey or by waypoints"
            self._source.find((*where, "complexItemType"), f"item {number}, a {kind}, does not store its items", hint)
            return None
        if version not in versions:
            message = f"item {number}: a {kind} of version {version!r} is not supported, only {_listed(versions)}"
            self._source.find((*where, "version"), message, SAVE_AGAIN)
            return None
        transect = item.get("TransectStyleComplexItem")
        stored = transect.get("Items") if isinstance(transect, dict) else None
        if not isinstance(stored, list) or not stored:
            message = f"item {number}, a {kind}, lacks its items (TransectStyleComplexItem.Items)"
            self._source.find(where, message, SAVE_AGAIN)
            return None
        inner = (*where, "TransectStyleComplexItem", "Items")
        items = [self._item(one, (*inner, index)) for index, one in enumerate(stored)]
        entry = PlanEntry(items=tuple(one for one in items if one is not None), raw=item)
        return _Entry(entry, tuple((*inner, index) for index, one in enumerate(items) if one is not None))

    def _item(self, item: Any, where: Where) -> MavItem | None:
        if not isinstance(item, dict):
            self._source.find(where, "an item is expected here", SAVE_AGAIN)
            return None
        command, frame = item.get("command"), item.get("frame")
        if not is_whole(command, 65_535) or not is_whole(frame, 255):
            self._source.find(where, "the item's command or frame is not a MAVLink number", SAVE_AGAIN)
            return None
        params = item.get("params")
        if isinstance(params, list) and len(params) == 4 and isinstance(item.get("coordinate"), list):
            params = [*params, *item["coordinate"]]
        if not isinstance(params, list) or len(params) != 7 or not all(one is None or is_number(one) for one in params):
            self._source.find(
                (*where, "params"), "seven numbers (or null) are expected, or four and a coordinate", SAVE_AGAIN
            )
            return None
        p1, p2, p3, p4, x, y, z = (None if one is None else float(one) for one in params)
        is_continued = item.get("autoContinue", True)
        if not isinstance(is_continued, bool):
            self._source.find((*where, "autoContinue"), "true or false is expected here")
        return MavItem(
            command=command, frame=frame, params=(p1, p2, p3, p4), x=x, y=y, z=z, is_continued=bool(is_continued)
        )

    def _fence(self, fence: Any) -> tuple[FenceArea, ...]:
        if fence is None:
            return ()
        where: Where = ("geoFence",)
        if not isinstance(fence, dict):
            self._source.find(where, "the fence is not a mapping", SAVE_AGAIN)
            return ()
        if fence.get("version") == 1 and not fence.get("polygon"):
            return ()  # an old file without a fence
        if fence.get("version") != 2:
            self._source.find(where, f"fence version {fence.get('version')!r} is not supported, only 2", SAVE_AGAIN)
            return ()
        areas: list[FenceArea] = []
        for index, one in self._rows(fence, where, "circles"):
            place = (*where, "circles", index)
            circle = one.get("circle")
            circle = circle if isinstance(circle, dict) else {}
            center, radius = self._source.numbers(circle.get("center"), 2, place), circle.get("radius")
            if not is_number(radius) or radius <= 0.0:
                self._source.find(place, "the circle has no radius")
            elif center:
                inside = one.get("inclusion") is not False
                areas.append(FenceArea(is_inclusion=inside, center=(center[0], center[1]), radius_m=float(radius)))
        for index, one in self._rows(fence, where, "polygons"):
            place = (*where, "polygons", index)
            written = one.get("polygon")
            if not isinstance(written, list):
                self._source.find((*place, "polygon"), "a list of corners is expected here", SAVE_AGAIN)
                continue
            corners = [self._source.numbers(corner, 2, place) for corner in written]
            if len(corners) < 3:
                self._source.find(place, "a polygon of the fence has fewer than three corners")
            inside = one.get("inclusion") is not False
            areas.append(FenceArea(is_inclusion=inside, polygon=tuple((c[0], c[1]) for c in corners if c)))
        return tuple(areas)

    def _rows(self, holder: dict[str, Any], where: Where, key: str) -> list[tuple[int, dict[str, Any]]]:
        """The mappings of a list with their indexes; anything else there is a finding."""
        value = holder.get(key)
        if value is not None and not isinstance(value, list):
            self._source.find((*where, key), "a list is expected here", SAVE_AGAIN)
            return []
        for index, one in enumerate(value or ()):
            if not isinstance(one, dict):
                self._source.find((*where, key, index), f"an entry of {key} is not a mapping", SAVE_AGAIN)
        return [(index, one) for index, one in enumerate(value or ()) if isinstance(one, dict)]

    def _rally(self, rally: Any) -> tuple[tuple[float, float, float], ...]:
        points = rally.get("points") if isinstance(rally, dict) else None
        if not points:
            return ()
        if rally.get("version") not in (1, 2):
            self._source.find(
                ("rallyPoints",), f"rally points version {rally.get('version')!r} is not supported", SAVE_AGAIN
            )
            return ()
        if not isinstance(points, list):
            self._source.find(("rallyPoints",), "the rally points are not a list", SAVE_AGAIN)
            return ()
        found = [self._source.numbers(point, 3, ("rallyPoints", "points", index)) for index, point in enumerate(points)]
        return tuple((p[0], p[1], p[2]) for p in found if p)


def _without_own(value: dict[str, Any]) -> dict[str, Any]:
    """Other contents of a file, besides those in the model."""
    raw = {key: inner for key, inner in value.items() if key not in ("mission", "geoFence", "rallyPoints", "version")}
    mission = value.get("mission")
    if isinstance(mission, dict):
        raw["mission"] = {key: inner for key, inner in mission.items() if key not in _OWN_KEYS}
    for key, own in (("geoFence", ("circles", "polygons", "version")), ("rallyPoints", ("points", "version"))):
        if isinstance(value.get(key), dict):
            raw[key] = {name: inner for name, inner in value[key].items() if name not in own}
    return raw


def _listed(versions: Sequence[int]) -> str:
    return " and ".join(str(version) for version in versions)


def write_plan(plan: ForeignPlan) -> str:
    """Writes a `.plan` file; entries that were read from one are written unchanged."""
    raw = plan.raw or {}
    mission: dict[str, Any] = {
        "cruiseSpeed": plan.cruise_speed_m_s if plan.cruise_speed_m_s is not None else 5.0,
        "firmwareType": plan.firmware_type if plan.firmware_type is not None else 12,
        "hoverSpeed": plan.hover_speed_m_s if plan.hover_speed_m_s is not None else 5.0,
        "items": [entry.raw or _simple(entry.items[0], index + 1) for index, entry in enumerate(plan.entries)],
        "plannedHomePosition": list(plan.home or (0.0, 0.0, 0.0)),
        "vehicleType": plan.vehicle_type if plan.vehicle_type is not None else 2,
        "version": 2,
    }
    fence = {
        "circles": [
            {"circle": {"center": list(a.center), "radius": a.radius_m}, "inclusion": a.is_inclusion, "version": 1}
            for a in plan.fence
            if a.center is not None
        ],
        "polygons": [
            {"inclusion": a.is_inclusion, "polygon": [list(corner) for corner in a.polygon], "version": 1}
            for a in plan.fence
            if a.center is None
        ],
        "version": 2,
    }
    written = {
        "fileType": "Plan",
        "geoFence": raw.get("geoFence", {}) | fence,
        "groundStation": "QGroundControl",
        "mission": raw.get("mission", {}) | mission,
        "rallyPoints": raw.get("rallyPoints", {}) | {"points": [list(point) for point in plan.rally], "version": 2},
        "version": 1,
    }
    others = {key: value for key, value in raw.items() if key not in written or key == "groundStation"}
    return json.dumps(written | others, indent=4) + "\n"


def _simple(item: MavItem, number: int) -> dict[str, Any]:
    return {
        "autoContinue": item.is_continued,
        "command": item.command,
        "doJumpId": number,
        "frame": item.frame,
        "params": [*item.params, item.x, item.y, item.z],
        "type": "SimpleItem",
    }
