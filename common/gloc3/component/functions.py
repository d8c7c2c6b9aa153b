"""Function messages (paper, Table II): typed requests to a component that is working or quiet."""

from collections.abc import Mapping
from typing import Annotated, Any, Final

import msgspec

from gloc3.component.component import Component, FunctionEntry
from gloc3.component.settings import not_finite
from gloc3.errors import Refused, nearest
from gloc3.messages.envelope import FunctionRequest, Message


class SetRate(Message, frozen=True):
    """Changes the rate of the periodic cycles while the component is working."""

    rate_hz: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)]


class SetRateReply(Message, frozen=True):
    """The rate that is now kept."""

    rate_hz: float


class SetLogging(Message, frozen=True):
    """Changes what the data logger records at the end of every cycle."""

    items: list[str] | None = None
    """Names of the component's loggable items; None leaves them as they are."""
    is_enabled: bool = True


class SetLoggingReply(Message, frozen=True):
    """The items that are now recorded."""

    items: list[str]


GENERIC: Final[Mapping[str, FunctionEntry]] = {
    "set_rate": FunctionEntry("set_rate", "", SetRate, SetRateReply, SetRate.__doc__ or ""),
    "set_logging": FunctionEntry("set_logging", "", SetLogging, SetLoggingReply, SetLogging.__doc__ or ""),
}
"""The functions that every component has; its host answers them."""


def decode_request(component: type[Component[Any]], request: FunctionRequest) -> tuple[FunctionEntry, Any]:
    """The function that a request names, and its arguments checked against the function's type.

    Raises:
        Refused: there is no such function, or the arguments do not fit.
    """
    known = {**GENERIC, **component.functions}
    entry = known.get(request.function)
    if entry is None:
        raise Refused(f"no function {request.function!r}; {nearest(request.function, list(known))}")
    for path in not_finite(request.arguments):
        raise Refused(f"{request.function}: {path} is not a finite number")
    fields = [field.encode_name for field in msgspec.structs.fields(entry.request)]
    for name in request.arguments:
        if name not in fields:
            raise Refused(f"{request.function}: unknown argument {name!r}; {nearest(name, fields)}")
    try:
        return entry, msgspec.convert(request.arguments, entry.request)
    except msgspec.ValidationError as error:
        raise Refused(f"{request.function}: {error}") from error
