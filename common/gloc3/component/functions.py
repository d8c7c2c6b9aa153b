"""Function messages (paper, Table II): typed requests to a component that is working or quiet.

They are checked, run between cycles, and replied to.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Final

import msgspec

from gloc3.component.component import Component, FunctionEntry
from gloc3.component.error_handler import describe, reason_of
from gloc3.component.hosted import HostedComponent
from gloc3.component.jobs import FunctionJob
from gloc3.component.lci import OPERATING
from gloc3.component.settings import not_finite
from gloc3.errors import Refused, nearest
from gloc3.messages.envelope import FunctionReply, FunctionRequest, Message

WAITING_MAX: Final = 16
"""Functions that may wait for their turn; more are refused."""


class SetRate(Message, frozen=True):
    """Changes the rate of the periodic cycles while the component is working."""

    rate_hz: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)]


class SetRateReply(Message, frozen=True):
    """The rate that is now kept."""

    rate_hz: float


class SetLogging(Message, frozen=True):
    """Changes which items the data logger records at the end of every cycle."""

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


class FunctionDesk:
    """Takes the function requests of one component."""

    def __init__(self, hosted: HostedComponent) -> None:
        self._hosted = hosted

    def handle(self, request: FunctionRequest, now_s: float) -> None:
        """Answers a request, now or when the function has run."""
        hosted = self._hosted
        try:
            if hosted.state not in OPERATING:
                raise Refused(f"functions are taken while working or quiet; it is {hosted.state or 'absent'}")
            if hosted.is_busy:
                raise Refused("busy: no function is taken while a command is carried out")
            if len(hosted.jobs.running) >= WAITING_MAX:
                raise Refused(f"busy: {WAITING_MAX} functions wait already")
            entry, arguments = decode_request(type(hosted.component), request)
            if isinstance(arguments, SetRate | SetLogging):
                self._reply(request, result=self._generic(arguments))
                return
        except Refused as refusal:
            self._reply(request, str(refusal))
            return
        job = FunctionJob(hosted.component, entry, arguments, now_s, hosted.gate, is_device_live=hosted.is_device_live)
        hosted.jobs.run(
            job.run,
            lambda job: self._ended(request, job),
            lambda cause: self._reply(request, f"{request.function} failed: {cause}"),
            what=f"function {entry.name}",
            limit_s=hosted.row.timeout_s,
            cost_s=hosted.method_cost_s(entry.name),
        )

    def _generic(self, arguments: SetRate | SetLogging) -> dict[str, Any]:
        reply: Message
        if isinstance(arguments, SetRate):
            self._hosted.set_rate(arguments.rate_hz)
            reply = SetRateReply(rate_hz=arguments.rate_hz)
        else:
            reply = SetLoggingReply(items=self._hosted.set_logging(arguments.items, arguments.is_enabled))
        result: dict[str, Any] = msgspec.to_builtins(reply)
        return result

    def _ended(self, request: FunctionRequest, job: FunctionJob) -> None:
        for failure in job.failures:
            self._hosted.count(failure)
        if job.is_skipped:
            self._reply(request, f"{request.function} was not carried out: {self._hosted.errors.last_cause}")
        elif isinstance(job.error, Refused):
            self._reply(request, reason_of(job.error))
        elif job.error is not None:
            self._hosted.fault(describe(job.error), job.error, is_device_safe=True)
            self._reply(request, f"{request.function} failed: {describe(job.error)}")
        else:
            self._reply(request, result=job.result)

    def _reply(self, request: FunctionRequest, refusal: str = "", result: dict[str, Any] | None = None) -> None:
        self._hosted.publish(
            "function_reply",
            FunctionReply(
                request_id=request.request_id,
                component=self._hosted.row.name,
                function=request.function,
                is_accepted=not refusal,
                reason=refusal,
                result=result or {},
            ),
        )
