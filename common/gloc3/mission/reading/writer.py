"""Writes a mission as the YAML that it can be read from again."""

from collections.abc import Mapping
from typing import Any

import msgspec
from msgspec import structs

from gloc3.documents.document import dump
from gloc3.documents.format_version import STAMP
from gloc3.mission.model.model import Action, Contingency, Mission, Policies, Task, answer
from gloc3.mission.model.placement import HeightAbove
from gloc3.mission.model.policy import Policy


def write_mission(mission: Mission) -> str:
    """The text of a mission file; default values are left out."""
    written: dict[str, Any] = {**STAMP, "mission": mission.name, "frame": mission.frame}
    if mission.platform is not None:
        written["platform"] = mission.platform
    if mission.height_above is not HeightAbove.HOME:
        written["height_above"] = mission.height_above.value
    if mission.deadline_s is not None:
        written["deadline_s"] = mission.deadline_s
    if mission.geofence is not None:
        written["geofence"] = msgspec.to_builtins(mission.geofence)
    written |= msgspec.to_builtins(mission.policies)
    written["tasks"] = {name: _task(task) for name, task in mission.tasks.items()}
    if mission.contingencies:
        written["contingencies"] = {name: _task(task) for name, task in mission.contingencies.items()}
    return dump(written)


def single_action(name: str, capability: str, arguments: Mapping[str, Any], mission: Mission | None, frame: str) -> str:
    """Text of a mission with a single action: a low-level command has the same processing and the same checks.

    Args:
        name: of its task.
        capability: the capability.
        arguments: as in a mission file.
        mission: the loaded one, whose frame and fence apply; None without one.
        frame: the frame of the arguments, where there is no mission.
    """
    written: dict[str, Any] = {"mission": name, "frame": frame, "on_failure": Policy.CONTINUE.value}
    if mission is not None:
        written["frame"] = mission.frame
        if mission.height_above is not HeightAbove.HOME:
            written["height_above"] = mission.height_above.value
        if mission.geofence is not None:
            written["geofence"] = msgspec.to_builtins(mission.geofence)
        written = msgspec.to_builtins(structs.replace(mission.policies, **_answers(mission.policies))) | written
    written["tasks"] = {name: {"actions": {capability: {capability: dict(arguments)}}}}
    return dump(written)


def _answers(policies: Policies) -> dict[str, str]:
    """The answers to conditions without the tasks that they name: a single action has no such tasks with it."""
    found = {name: getattr(policies, name) for name in policies.__struct_fields__}
    return {name: answer(one).value for name, one in found.items() if isinstance(one, Contingency)}


def _task(task: Task) -> dict[str, Any]:
    written: dict[str, Any] = {
        key: value for key, value in msgspec.to_builtins(task.options).items() if key != "actions"
    }
    if task.options.plan is None:
        written["actions"] = {name: _action(action) for name, action in task.actions.items()}
    return written


def _action(action: Action) -> dict[str, Any]:
    return {action.capability: msgspec.to_builtins(action.arguments), **msgspec.to_builtins(action.options)}
