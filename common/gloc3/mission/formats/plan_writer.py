"""Writes `.plan` files for QGroundControl; what was read from one stands in it again as it was."""

import json
from typing import Any

from gloc3.mission.formats.items import MavItem, Plan


def write_plan(plan: Plan) -> str:
    """The `.plan` file; what was read from one stands in it again as it was."""
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
