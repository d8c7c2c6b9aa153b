"""Where function messages of one component are answered (paper, Table II): checked, run between cycles, replied to."""

from typing import Any, Final

import msgspec

from gloc3.component.component import Component, FunctionEntry
from gloc3.component.error_handler import Failure, describe, reason_of
from gloc3.component.functions import SetLogging, SetLoggingReply, SetRate, SetRateReply, decode_request
from gloc3.component.gate import Gate
from gloc3.component.guard import guard
from gloc3.component.hosted import HostedComponent
from gloc3.component.lci import OPERATING
from gloc3.component.method_job import make_safe
from gloc3.errors import Misuse, Refused
from gloc3.messages.envelope import FunctionReply, FunctionRequest, Message

WAITING_MAX: Final = 16
"""Functions that may wait for their turn; more are refused."""


class FunctionJob:
    """One function of a component, as its worker runs it."""

    def __init__(
        self,
        component: Component[Any],
        entry: FunctionEntry,
        arguments: Message,
        now_s: float,
        gate: Gate,
        *,
        is_device_live: bool,
    ) -> None:
        self.result: dict[str, Any] = {}
        self.error: BaseException | None = None
        self.failures: list[Failure] = []
        self.is_skipped = False
        """The gate was shut before the job's turn came."""
        self._component = component
        self._entry = entry
        self._arguments = arguments
        self._now_s = now_s
        self._gate = gate
        self._is_device_live = is_device_live

    def run(self) -> "FunctionJob":
        """On the worker."""
        self.is_skipped = self._gate.is_shut
        if not self.is_skipped:
            _, self.error = guard(self._run)
            if self.error is not None and not isinstance(self.error, Refused):
                if self._is_device_live and not self._gate.is_shut:
                    make_safe(self._component, self.failures)
                self._gate.is_shut = True
        return self

    def _run(self) -> None:
        reply = getattr(self._component, self._entry.method)(self._arguments, self._now_s)
        if not isinstance(reply, self._entry.reply):
            found, expected = type(reply).__name__, self._entry.reply.__name__
            raise Misuse(f"function {self._entry.name} gave {found}, not {expected}")
        self.result = msgspec.to_builtins(reply, builtin_types=(bytes,))


class FunctionDesk:
    """Takes the function requests of one component."""

    def __init__(self, hosted: HostedComponent) -> None:
        self._hosted = hosted

    def take(self, request: FunctionRequest, now_s: float) -> None:
        """Answers a request, now or when the function has run."""
        hosted = self._hosted
        try:
            if hosted.state not in OPERATING:
                raise Refused(f"functions are taken while working or quiet; it is {hosted.state or 'absent'}")
            if hosted.is_busy:
                raise Refused("busy: no function is taken while a command is carried out")
            if len(hosted.errands) >= WAITING_MAX:
                raise Refused(f"busy: {WAITING_MAX} functions wait already")
            entry, arguments = decode_request(type(hosted.component), request)
            if isinstance(arguments, SetRate | SetLogging):
                self._reply(request, result=self._generic(arguments))
                return
        except Refused as refusal:
            self._reply(request, str(refusal))
            return
        job = FunctionJob(hosted.component, entry, arguments, now_s, hosted.gate, is_device_live=hosted.is_device_live)
        hosted.errands.run(
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
        self._hosted.tell(
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
