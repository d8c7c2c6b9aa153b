"""Requests of the mission executor to its caller, to be carried out in order."""

from typing import Any

import msgspec

from gloc3.messages.envelope import Severity
from gloc3.mission.executing.snapshot import Snapshot


class Request(msgspec.Struct, frozen=True, kw_only=True):
    """The base of all requests."""


class Persist(Request, frozen=True, kw_only=True):
    """Write this to disk before any following request is executed or reported."""

    snapshot: Snapshot


class Grant(Request, frozen=True, kw_only=True):
    """Motion has a new owner; publish it, now and periodically, until the next one."""

    action_id: str
    """`hold` where no action owns motion and the hold controller keeps the vehicle; empty: no component may move it."""
    component: str


class ToComponent(Request, frozen=True, kw_only=True):
    """The base of the function messages; the reply goes to `MissionExecutor.replied`."""

    action_id: str
    component: str


class Start(ToComponent, frozen=True, kw_only=True):
    """`action.start`."""

    capability: str
    arguments: dict[str, Any]
    """The order, as plain values."""
    progress: float = 0.0
    """How far an earlier attempt had come."""


class Pause(ToComponent, frozen=True, kw_only=True):
    """`action.pause`."""


class Resume(ToComponent, frozen=True, kw_only=True):
    """`action.resume`."""


class Cancel(ToComponent, frozen=True, kw_only=True):
    """`action.cancel`."""


class ReclaimMotion(Request, frozen=True, kw_only=True):
    """An operator resumes after a pilot had control; notify the driver."""


class MissionEvent(Request, frozen=True, kw_only=True):
    """Something that the operators and the log should read."""

    severity: Severity
    text: str
    cause: str = ""
    """What it follows from; empty for what stands for itself."""
