"""The parameter protocol on the vehicle: tells its parameters, and lets them be set."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Final

import msgspec

from gloc3.errors import Refused
from gloc3.link.message import Address, MavlinkMessage
from gloc3.link.parameter import LONGEST_NAME, Parameter, ParameterEncoding, ParameterType, parameter, read_parameter
from gloc3.link.service import Service

PER_SECOND: Final = 200.0
"""Parameters of a whole list; a radio has to do other things too."""
BURST_S: Final = 0.02
CAST_ROUNDING: Final = 0.01

_DOES_NOT_EXIST: Final = 1
_VALUE_OUT_OF_RANGE: Final = 2


class ParameterChanged(msgspec.Struct, frozen=True):
    """A parameter was set from outside."""

    parameter: Parameter
    before: Parameter
    sender: Address


def allow_all(_wanted: Parameter) -> None:
    """Allows every value that fits the type."""


class ParameterServer(Service[ParameterChanged]):
    """Holds a vehicle's parameters, in the order of their names.

    Args:
        own: as whom it speaks.
        parameters: all that there are; none comes later.
        encoding: how integers travel.
        check: raises `Refused` for a value that must not be.
        per_second: how many parameters of a whole list are sent in a second.
    """

    handles = frozenset({"PARAM_REQUEST_LIST", "PARAM_REQUEST_READ", "PARAM_SET"})

    def __init__(
        self,
        own: Address,
        parameters: Iterable[Parameter],
        *,
        encoding: ParameterEncoding = ParameterEncoding.BYTEWISE,
        check: Callable[[Parameter], None] = allow_all,
        per_second: float = PER_SECOND,
    ) -> None:
        super().__init__(own)
        self._values = {each.name: each for each in sorted(parameters, key=lambda each: each.name)}
        self._names = tuple(self._values)
        self._index = {name: index for index, name in enumerate(self._names)}
        self._encoding = encoding
        self._check = check
        self._burst = max(1, round(per_second * BURST_S))
        self._burst_s = self._burst / per_second
        self._listed: int | None = None
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
        """Sets a parameter from this side, and tells everybody.

        Raises:
            Refused: there is no such parameter, or the value does not fit.
        """
        before = self._values.get(name)
        if before is None:
            raise Refused(f"there is no parameter {name}")
        self._values[name] = parameter(name, value, before.type)
        self._tell(name)

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Takes in a request."""
        if not self._is_for_us(message):
            return
        match message.name:
            case "PARAM_REQUEST_LIST":
                self._listed = 0
                self._next_s = now_s
            case "PARAM_REQUEST_READ":
                index = message.param_index
                name = self._names[index] if 0 <= index < len(self._names) else message.param_id
                if name in self._values:
                    self._tell(name)
                else:
                    self._refuse(sender, name, index, _DOES_NOT_EXIST)
            case _:
                self._set(message, sender)

    def tick(self, now_s: float) -> None:
        """Sends the next few of a list."""
        if self._listed is None or now_s < self._next_s:
            return
        for name in self._names[self._listed : self._listed + self._burst]:
            self._tell(name)
        self._listed += self._burst
        self._next_s = now_s + self._burst_s
        if self._listed >= len(self._names):
            self._listed = None

    def next_tick_s(self) -> float | None:
        """When the next few are due."""
        return None if self._listed is None else self._next_s

    def _set(self, message: MavlinkMessage, sender: Address) -> None:
        name = message.param_id
        before = self._values.get(name)
        if before is None:
            self._refuse(sender, name, -1, _DOES_NOT_EXIST)
            return
        value = self._value(message, before.type)
        if value is None or not math.isfinite(value):
            self._refuse(sender, name, -1, _VALUE_OUT_OF_RANGE)
        else:
            try:
                wanted = parameter(name, value, before.type)
                self._check(wanted)
            except Refused:
                self._refuse(sender, name, -1, _VALUE_OUT_OF_RANGE)
            else:
                self._values[name] = wanted
                if not wanted.is_same(before):
                    self._events.append(ParameterChanged(wanted, before, sender))
        self._tell(name)

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

    def _tell(self, name: str) -> None:
        told = self._values[name]
        self._send(
            "PARAM_VALUE",
            param_id=name,
            param_value=told.to_bits(self._encoding),
            param_type=told.type,
            param_count=len(self._names),
            param_index=self._index[name],
        )

    def _refuse(self, sender: Address, name: str, index: int, error: int) -> None:
        fitting = name.encode()[:LONGEST_NAME]
        self._send_to(sender, "PARAM_ERROR", param_id=fitting, param_index=index, error=error)
