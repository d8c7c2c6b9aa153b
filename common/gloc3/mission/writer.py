"""Writes a mission as the YAML that it can be read from again."""

from typing import Any

import msgspec

from gloc3.document import dump
from gloc3.mission.arguments import Arguments
from gloc3.mission.model import Action, Mission, Task
from gloc3.mission.placement import HeightAbove


def write_mission(mission: Mission) -> str:
    """The file of a mission; what has its default value is left out."""
    written: dict[str, Any] = {"mission": mission.name, "frame": mission.frame}
    if mission.height_above is not HeightAbove.HOME:
        written["height_above"] = mission.height_above.value
    if mission.deadline_s is not None:
        written["deadline_s"] = mission.deadline_s
    if mission.geofence is not None:
        written["geofence"] = msgspec.to_builtins(mission.geofence)
    written |= msgspec.to_builtins(mission.policies)
    written["tasks"] = {name: _task(task) for name, task in mission.tasks.items()}
    return dump(written)


def single_action(capability: str, arguments: Arguments, frame: str) -> str:
    """The file of a mission that is one action: how a low-level command takes the same path as a mission."""
    action = {capability: msgspec.to_builtins(arguments)}
    return dump({"mission": capability, "frame": frame, "tasks": {"command": {"actions": {capability: action}}}})


def _task(task: Task) -> dict[str, Any]:
    written: dict[str, Any] = {
        key: value for key, value in msgspec.to_builtins(task.options).items() if key != "actions"
    }
    written["actions"] = {name: _action(action) for name, action in task.actions.items()}
    return written


def _action(action: Action) -> dict[str, Any]:
    return {action.capability: msgspec.to_builtins(action.arguments), **msgspec.to_builtins(action.options)}
