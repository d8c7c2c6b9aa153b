"""Server of the parameter protocol: sends the vehicle's parameters, and sets them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from enum import IntEnum
from typing import Final

import msgspec

from gloc3.errors import Refused
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.services.parameter import (
    LONGEST_NAME,
    Parameter,
    ParameterEncoding,
    ParameterType,
    parameter,
    read_parameter,
)

PER_SECOND: Final = 200.0
"""Parameters of a whole list; a radio has to do other things too."""
BURST_S: Final = 0.02
CAST_ROUNDING: Final = 0.01


class ParameterError(IntEnum):
    """Reasons why a parameter cannot be read or set: MAV_PARAM_ERROR."""

    DOES_NOT_EXIST = 1
    VALUE_OUT_OF_RANGE = 2
    PERMISSION_DENIED = 3
    READ_ONLY = 5
    TYPE_MISMATCH = 7


class ParameterRefused(Refused):
    """A value is turned down, and not because it is out of range."""

    def __init__(self, reason: str, error: ParameterError) -> None:
        super().__init__(reason)
        self.error: Final = error


class ParameterChanged(msgspec.Struct, frozen=True):
    """A parameter was set from outside."""

    parameter: Parameter
    before: Parameter
    sender: Address


def allow_all(_wanted: Parameter) -> None:
    """Allows every value that fits the type."""


class ParameterWanted(msgspec.Struct, frozen=True):
    """A value that is to be set, and is left to the owner: he ends it with `conclude`."""

    parameter: Parameter
    sender: Address


def decide_at_once(_wanted: ParameterWanted) -> bool:
    """Leaves no value to the owner."""
    return False


class ParameterServer(Microservice[ParameterChanged | ParameterWanted]):
    """Holds a vehicle's parameters, in the order of their names.

    Args:
        own: address of this end.
        parameters: all parameters; none can be added later.
        encoding: encoding of integers.
        check: raises `Refused` for an invalid value.
        leave: whether the owner decides on a valid value, by `ParameterWanted`; may raise `Refused`.
        per_second: parameters of a whole list sent per second.
    """

    handles = frozenset({"PARAM_REQUEST_LIST", "PARAM_REQUEST_READ", "PARAM_SET"})

    def __init__(
        self,
        own: Address,
        parameters: Iterable[Parameter],
        *,
        encoding: ParameterEncoding = ParameterEncoding.BYTEWISE,
        check: Callable[[Parameter], None] = allow_all,
        leave: Callable[[ParameterWanted], bool] = decide_at_once,
        per_second: float = PER_SECOND,
        tells_unknown: bool = True,
    ) -> None:
        super().__init__(own)
        self._values = {each.name: each for each in sorted(parameters, key=lambda each: each.name)}
        self._names = tuple(self._values)
        self._index = {name: index for index, name in enumerate(self._names)}
        self._encoding = encoding
        self._check = check
        self._leave = leave
        self._tells_unknown = tells_unknown
        self._wanted: dict[str, ParameterWanted] = {}
        self._burst = max(1, round(per_second * BURST_S))
        self._burst_s = self._burst / per_second
        self._listed: int | None = None
        self._is_wanted_again = False
        self._next_s = 0.0

    def __getitem__(self, name: str) -> float:
        return self._values[name].value

    def __contains__(self, name: str) -> bool:
        return name in self._values

    @property
    def parameters(self) -> list[Parameter]:
        """All of them as they are now."""
        return list(self._values.values())

    def set(self, name: str, value: float) -> None:
        """Sets a parameter from this side, and reports it to all clients.

        Raises:
            Refused: there is no such parameter, or the value does not fit.
        """
        before = self._values.get(name)
        if before is None:
            raise Refused(f"there is no parameter {name}")
        self._values[name] = parameter(name, value, before.type)
        self._send_value(name)

    def conclude(self, wanted: ParameterWanted, error: ParameterError | None) -> None:
        """Ends a requested change: applied or refused; the result is reported either way."""
        name = wanted.parameter.name
        if self._wanted.get(name) is not wanted:
            return
        del self._wanted[name]
        if error is None:
            self._values[name] = wanted.parameter
        else:
            self._refuse(wanted.sender, name, -1, error)
        self._send_value(name)

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Takes in a request."""
        if not self._is_for_us(message):
            return
        match message.name:
            case "PARAM_REQUEST_LIST":
                if self._listed is None:
                    self._listed, self._next_s = 0, now_s
                else:  # who asks while a list is sent gets the next one whole: begun anew, none would come to its end
                    self._is_wanted_again = self._listed > 0
            case "PARAM_REQUEST_READ":
                index = message.param_index
                name = self._names[index] if 0 <= index < len(self._names) else message.param_id
                if name in self._values:
                    self._send_value(name)
                else:
                    self._refuse(sender, name, index, ParameterError.DOES_NOT_EXIST)
            case _:
                self._set(message, sender)

    def tick(self, now_s: float) -> None:
        """Sends the next few of a list."""
        if self._listed is None or now_s < self._next_s:
            return
        for name in self._names[self._listed : self._listed + self._burst]:
            self._send_value(name)
        self._listed += self._burst
        self._next_s = now_s + self._burst_s
        if self._listed >= len(self._names):
            self._listed = 0 if self._is_wanted_again else None
            self._is_wanted_again = False

    def next_tick_s(self) -> float | None:
        """When the next few are due."""
        return None if self._listed is None else self._next_s

    def _set(self, message: MavlinkMessage, sender: Address) -> None:
        name = message.param_id
        before = self._values.get(name)
        if before is None:
            self._refuse(sender, name, -1, ParameterError.DOES_NOT_EXIST)
            return
        value = self._value(message, before.type)
        try:
            if value is None:
                raise ParameterRefused(f"{name} is of another type", ParameterError.TYPE_MISMATCH)
            if not math.isfinite(value):
                raise Refused(f"{name} must be a number")
            wanted = parameter(name, value, before.type)
            self._check(wanted)
            if self._is_left(ParameterWanted(wanted, sender)):
                return
        except ParameterRefused as refusal:
            self._refuse(sender, name, -1, refusal.error)
        except Refused:
            self._refuse(sender, name, -1, ParameterError.VALUE_OUT_OF_RANGE)
        else:
            self._values[name] = wanted
            if not wanted.is_same(before):
                self._events.append(ParameterChanged(wanted, before, sender))
        self._send_value(name)

    def _is_left(self, wanted: ParameterWanted) -> bool:
        """Whether a value waits for the owner; repeated requests wait with it."""
        name = wanted.parameter.name
        waiting = self._wanted.get(name)
        if waiting is not None:
            if waiting.sender == wanted.sender and waiting.parameter.is_same(wanted.parameter):
                return True
            raise ParameterRefused(f"{name} is just being set", ParameterError.PERMISSION_DENIED)
        if not self._leave(wanted):
            return False
        self._wanted[name] = wanted
        self._events.append(wanted)
        return True

    def _value(self, message: MavlinkMessage, kind: ParameterType) -> float | None:
        """The value that is to be set; None where it comes as another type than the parameter's.

        With the cast encoding every type travels as the same float, which is cast to the parameter's own type whatever
        the message calls it: ground stations send REAL32 to all. As ArduPilot does it, the fraction is cut off, after a
        little was added so that 2.9999 is 3.
        """
        if self._encoding is ParameterEncoding.CAST:
            sent = read_parameter(message.param_id, message.param_value, ParameterType.REAL32, self._encoding)
            if sent is None or kind is ParameterType.REAL32 or not math.isfinite(sent.value):
                return None if sent is None else sent.value
            return math.trunc(sent.value + math.copysign(CAST_ROUNDING, sent.value))
        sent = read_parameter(message.param_id, message.param_value, message.param_type, self._encoding)
        return sent.value if sent is not None and sent.type is kind else None

    def _send_value(self, name: str) -> None:
        reported = self._values[name]
        self._send(
            "PARAM_VALUE",
            param_id=name,
            param_value=reported.to_bits(self._encoding),
            param_type=reported.type,
            param_count=len(self._names),
            param_index=self._index[name],
        )

    def _refuse(self, sender: Address, name: str, index: int, error: ParameterError) -> None:
        if error is ParameterError.DOES_NOT_EXIST and not self._tells_unknown:
            return
        fitting = name.encode()[:LONGEST_NAME]
        self._send_to(sender, "PARAM_ERROR", param_id=fitting, param_index=index, error=error)
