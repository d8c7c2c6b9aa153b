"""The layout for Foxglove beside a log: 3D scene, pictures, height and speed, events, map; topics as the log names them."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import msgspec

from gloc3.log.foxglove.scene import SCENE
from gloc3.log.foxglove.schemas import MAP_FRAME, body_frame

LAYOUT_FILE: Final = "foxglove-layout.json"
MOST_PICTURES: Final = 4
"""Image panels, at most."""

SCENE_TOPICS: Final = ("pose", "obstacles", "map", "laser")
"""Topics that the 3D panel can show, besides point clouds; below the platform's name."""
Element = dict[str, Any]


def layout(platform: str, cameras: Sequence[str], topics: Sequence[str]) -> bytes:
    """A layout, to be imported in Foxglove (Layouts, Import from file).

    Args:
        platform: the vehicle.
        cameras: names of the cameras whose pictures are recorded.
        topics: those of `SCENE_TOPICS`, and point clouds, that are recorded.
    """
    scene = {
        "topics": {name: {"visible": True} for name in (SCENE, *(f"{platform}/{below}" for below in topics))},
        "followTf": body_frame(platform),
        "fixedFrame": MAP_FRAME,
        "followMode": "follow-position",
    }
    pictures = [
        _panel(
            "Image",
            {"imageMode": {"imageTopic": f"{platform}/camera/{name}", "calibrationTopic": f"calibration/{name}"}},
            title=name,
        )
        for name in cameras[:MOST_PICTURES]
    ]
    numbers = [
        _plot("Height, m", [f'"{platform}/pose".position_ned_m[2].@mul(-1)']),
        _plot("Speed, m/s", [f'"{platform}/pose".velocity_ned_m_s[{axis}]' for axis in range(3)]),
        _panel("Log", {"topicToRender": f"{platform}/ci/event"}, title="Events"),
        _panel("Map", {"followTopic": f"{platform}/ci/vehicle"}, title="Map"),
    ]
    below = [(1.0, _split("row", [(1.0, one) for one in pictures]))] if pictures else []
    left = _split("column", [(2.0, _panel("ThreeDee", scene, title="Scene")), *below])
    content = _split("row", [(2.0, left), (1.0, _split("column", [(1.0, one) for one in numbers]))])
    return msgspec.json.format(msgspec.json.encode({"version": 1, "content": content}))


def _panel(kind: str, config: Mapping[str, Any], title: str) -> Element:
    return {"type": "panel", "panelType": kind, "config": config, "title": title, "version": 1}


def _plot(title: str, paths: Sequence[str]) -> Element:
    return _panel("Plot", {"paths": [{"value": path} for path in paths]}, title)


def _split(direction: str, items: Sequence[tuple[float, Element]]) -> Element:
    return {
        "type": "split",
        "direction": direction,
        "items": [{"proportion": share, "content": element} for share, element in items],
    }
