"""A layout for Foxglove against the log beside it: each panel's topics are there, with schemas that the panel shows."""

import json
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from mcap.reader import make_reader
from tests.common.log.foxglove_sdk import foxglove_fields, parsed

from gloc3.log.foxglove.layout import LAYOUT_FILE

SCENE: Final = {"SceneUpdate", "PoseInFrame", "PosesInFrame", "PointCloud", "LaserScan"}
"""Schemas of topics that the 3D panel shows (Foxglove's documentation of its panels), beside frames."""
PATH: Final = re.compile(r'"(?P<topic>[^"]+)"\.(?P<field>\w+)\[(?P<index>\d)\](?:\.@mul\(-1\))?')


def check_layout(folder: Path) -> dict[str, set[str]]:
    """Checks it, and returns the topics by the kind of panel."""
    layout = json.loads((folder / LAYOUT_FILE).read_text(encoding="utf-8"))
    log = _messages(folder / "log.mcap")
    found: dict[str, set[str]] = defaultdict(set)
    for kind, config in _panels(layout["content"]):
        match kind:
            case "ThreeDee":
                for topic in config["topics"]:
                    assert log[topic][0] in SCENE, topic
                    found[kind].add(topic)
                transforms = [each for message in log["frames"][1] for each in message["transforms"]]
                assert config["followTf"] in {each["child_frame_id"] for each in transforms}
                assert config["fixedFrame"] in {each["parent_frame_id"] for each in transforms}
            case "Image":
                mode = config["imageMode"]
                assert log[mode["imageTopic"]][0] == "CompressedImage"
                assert log[mode["calibrationTopic"]][0] == "CameraCalibration"
                found[kind] |= {mode["imageTopic"], mode["calibrationTopic"]}
            case "Plot":
                for path in config["paths"]:
                    words = PATH.fullmatch(path["value"])
                    assert words is not None, path
                    assert isinstance(log[words["topic"]][1][0][words["field"]][int(words["index"])], float)
                    found[kind].add(words["topic"])
            case "Log":
                assert log[config["topicToRender"]][0] == "Log"
                found[kind].add(config["topicToRender"])
            case "Map":
                assert log[config["followTopic"]][0] == "LocationFix"
                found[kind].add(config["followTopic"])
            case _:
                raise AssertionError(f"a panel of an unknown kind: {kind}")
    return found


def _panels(element: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    if element["type"] == "panel":
        yield element["panelType"], element["config"]
    for item in element.get("items", []):
        yield from _panels(item["content"])


def _messages(log: Path) -> dict[str, tuple[str, list[dict[str, Any]]]]:
    """Schema and messages by topic; those with a schema of Foxglove are parsed as its SDK describes it."""
    found: dict[str, tuple[str, list[dict[str, Any]]]] = {}
    with log.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            values = json.loads(message.data)
            name = "" if schema is None else schema.name
            if name.startswith("foxglove."):
                parsed(name, foxglove_fields(name, values, is_ours="type" in channel.metadata))
            found.setdefault(channel.topic, (name.removeprefix("foxglove."), []))[1].append(values)
    return found
