"""Client of the parameter protocol: reads and sets a vehicle's parameters; lost messages are requested again."""

from __future__ import annotations

from collections import deque
from enum import StrEnum
from typing import Final, TypeAlias

from gloc3.errors import Refused
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.round_trip import RESTLESS_S, RoundTrip
from gloc3.mavlink.service import Microservice, earliest
from gloc3.mavlink.services.parameter import Parameter, ParameterEncoding, ParameterType, parameter, read_parameter

SILENT_S: Final = 6.0
QUIET_S: Final = 0.5
"""Pause after which a list counts as sent and missing parameters are requested individually, s."""
MOST_VEHICLES: Final = 256
"""Senders whose parameters are kept."""
AT_ONCE: Final = 8
"""Requests for single parameters under way at the same time."""
DIFFERENT: Final = 3
"""Different values that must be returned before setting counts as refused: earlier answers may be under way."""


class ParameterResult(StrEnum):
    """Results of requests; the text is for a person."""

    DONE = "done"
    NO_SUCH = "there is no such parameter"
    REFUSED = "the vehicle keeps another value"
    NO_ANSWER = "no answer"
    CANCELLED = "cancelled"
    TOO_MANY_LOSSES = "gave up after repeated packet loss"


class ParameterCall:
    """One parameter being read or set."""

    __slots__ = ("_began_s", "_different", "_is_first", "_requested_s", "name", "result", "target", "value", "wanted")

    def __init__(self, target: Address, name: str, wanted: Parameter | None, now_s: float) -> None:
        self.target = target
        self.name = name
        self.wanted = wanted
        """What shall be set; None when it is read."""
        self.value: Parameter | None = None
        """What the vehicle says it is."""
        self.result: ParameterResult | None = None
        """None while it is not over."""
        self._began_s = now_s
        self._requested_s = now_s
        self._is_first = True
        self._different = 0


class ParameterFetch:
    """A vehicle's whole list being fetched."""

    __slots__ = (
        "_budget",
        "_by_index",
        "_quiet_s",
        "_received_s",
        "_requested_s",
        "_waiting",
        "count",
        "parameters",
        "result",
        "target",
    )

    def __init__(self, target: Address, now_s: float) -> None:
        self.target = target
        self.parameters: dict[str, Parameter] = {}
        """What has come so far, by name."""
        self.count: int | None = None
        """How many there are; None before the first."""
        self.result: ParameterResult | None = None
        """None while it is not over."""
        self._by_index: set[int] = set()
        self._requested_s: dict[int, float] = {}
        self._waiting: deque[int] | None = None
        self._received_s = now_s
        self._quiet_s = now_s + QUIET_S
        self._budget = 100

    @property
    def progress(self) -> float:
        """From 0 to 1."""
        return len(self._by_index) / self.count if self.count else 0.0


ParameterEvent: TypeAlias = ParameterCall | ParameterFetch | Parameter


class ParameterClient(Microservice[ParameterEvent]):
    """Reads and sets parameters.

    Calls and fetches are returned as events when they end. A parameter that arrives without a request, because another
    station has set it, is an event too.

    Args:
        own: address of this end.
        encoding: encoding of integers; PX4 and ArduPilot differ.
    """

    handles = frozenset({"PARAM_VALUE", "PARAM_ERROR"})

    def __init__(self, own: Address, encoding: ParameterEncoding = ParameterEncoding.BYTEWISE) -> None:
        super().__init__(own)
        self.encoding = encoding
        self.known: dict[Address, dict[str, Parameter]] = {}
        """Parameters received from each vehicle."""
        self._calls: dict[tuple[Address, str], ParameterCall] = {}
        self._fetches: dict[Address, ParameterFetch] = {}
        self._round_trips: dict[Address, RoundTrip] = {}

    def fetch(self, target: Address, *, now_s: float) -> ParameterFetch:
        """Fetches the whole list.

        Raises:
            Refused: a fetch is already under way.
        """
        if target in self._fetches:
            raise Refused(f"the parameters of {target.system}/{target.component} are being fetched")
        fetch = self._fetches[target] = ParameterFetch(target, now_s)
        self._send_to(target, "PARAM_REQUEST_LIST")
        return fetch

    def read(self, target: Address, name: str, *, now_s: float) -> ParameterCall:
        """Reads one.

        Raises:
            Refused: it is being read or set.
        """
        return self._begin(ParameterCall(target, name, None, now_s), now_s)

    def set(
        self, target: Address, name: str, value: float, kind: ParameterType | None = None, *, now_s: float
    ) -> ParameterCall:
        """Sets one parameter.

        Args:
            target: the vehicle.
            name: its name.
            value: the new value.
            kind: its type; None if the vehicle has reported it.
            now_s: now.

        Raises:
            Refused: it is being read or set, its type is unknown, or the value does not fit it.
        """
        if kind is None:
            known = self.known.get(target, {}).get(name)
            if known is None:
                raise Refused(f"the type of {name} is not known; read it first")
            kind = known.type
        return self._begin(ParameterCall(target, name, parameter(name, value, kind), now_s), now_s)

    def cancel(self, work: ParameterCall | ParameterFetch) -> None:
        """Stops requesting a parameter or a list; values that have been set stay set."""
        if isinstance(work, ParameterFetch):
            if self._fetches.get(work.target) is work:
                self._end_fetch(work, ParameterResult.CANCELLED)
        elif self._calls.get((work.target, work.name)) is work:
            self._end(work, ParameterResult.CANCELLED)

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Takes in a value, or an error."""
        call = self._calls.get((sender, message.param_id))
        if message.name == "PARAM_ERROR":
            if call is not None and self._is_for_us(message) and message.error == 1:
                self._end(call, ParameterResult.NO_SUCH)
            return
        reported = read_parameter(message.param_id, message.param_value, message.param_type, self.encoding)
        if reported is None:
            return
        known = self._known_of(sender)
        before = known.get(reported.name)
        if before is None and len(known) >= 10_000:
            return
        known[reported.name] = reported
        fetch = self._fetches.get(sender)
        if fetch is not None:
            self._store_parameter(fetch, reported, message.param_index, message.param_count, now_s)
        if call is not None:
            self._receive(call, reported, now_s)
        elif fetch is None and (before is None or not before.is_same(reported)):
            self._events.append(reported)

    def tick(self, now_s: float) -> None:
        """Repeats requests, or gives up."""
        for call in list(self._calls.values()):
            if now_s >= call._began_s + SILENT_S:
                self._end(call, ParameterResult.NO_ANSWER)
            elif now_s >= self._retry_s(call):
                self._round_trip(call.target).missed()
                call._is_first = False
                self._send_request(call, now_s)
        for fetch in list(self._fetches.values()):
            self._tick_fetch(fetch, now_s)

    def next_tick_s(self) -> float | None:
        """When one of these is due."""
        calls_s = [min(self._retry_s(call), call._began_s + SILENT_S) for call in self._calls.values()]
        return earliest(*calls_s, *(self._next_fetch_s(fetch) for fetch in self._fetches.values()))

    def _begin(self, call: ParameterCall, now_s: float) -> ParameterCall:
        if (call.target, call.name) in self._calls:
            raise Refused(f"{call.name} is being read or set")
        self._calls[call.target, call.name] = call
        self._send_request(call, now_s)
        return call

    def _send_request(self, call: ParameterCall, now_s: float) -> None:
        call._requested_s = now_s
        wanted = call.wanted
        if wanted is None:
            self._send_to(call.target, "PARAM_REQUEST_READ", param_id=call.name, param_index=-1)
        else:
            bits = wanted.to_bits(self.encoding)
            self._send_to(call.target, "PARAM_SET", param_id=call.name, param_value=bits, param_type=wanted.type)

    def _retry_s(self, call: ParameterCall) -> float:
        timeout_s = self._round_trip(call.target).timeout_s
        return call._requested_s + (timeout_s if call._is_first else min(timeout_s, RESTLESS_S))

    def _receive(self, call: ParameterCall, reported: Parameter, now_s: float) -> None:
        call.value = reported
        if call.wanted is None or call.wanted.is_same(reported):
            if call._is_first:
                self._round_trip(call.target).answered(now_s - call._requested_s)
            self._end(call, ParameterResult.DONE)
            return
        call._different += 1
        if call._different >= DIFFERENT:
            self._end(call, ParameterResult.REFUSED)

    def _end(self, call: ParameterCall, result: ParameterResult) -> None:
        del self._calls[call.target, call.name]
        call.result = result
        self._events.append(call)

    def _store_parameter(
        self, fetch: ParameterFetch, reported: Parameter, index: int, count: int, now_s: float
    ) -> None:
        fetch._received_s = now_s
        if fetch._waiting is None:
            fetch._quiet_s = now_s + QUIET_S
        if index >= count:
            return  # an answer to somebody's setting, not part of the list
        if count != fetch.count:
            fetch.count = count
            fetch._by_index = {known for known in fetch._by_index if known < count}
            fetch._budget = 100 + 3 * count
            fetch._waiting = None
            fetch._requested_s.clear()
        fetch._by_index.add(index)
        fetch._requested_s.pop(index, None)
        fetch.parameters[reported.name] = reported
        if len(fetch._by_index) == count:
            self._end_fetch(fetch, ParameterResult.DONE)
        elif fetch._waiting is not None:
            self._request_singly(fetch, now_s)

    def _tick_fetch(self, fetch: ParameterFetch, now_s: float) -> None:
        if now_s >= fetch._received_s + SILENT_S:
            self._end_fetch(fetch, ParameterResult.NO_ANSWER)
        elif fetch._waiting is None:
            if now_s >= fetch._quiet_s:
                self._list_is_quiet(fetch, now_s)
        else:
            timeout_s = self._single_timeout_s(fetch)
            for index in [
                index for index, requested_s in fetch._requested_s.items() if now_s >= requested_s + timeout_s
            ]:
                del fetch._requested_s[index]
                fetch._waiting.append(index)
        if fetch._waiting is not None and fetch.result is None:
            self._request_singly(fetch, now_s)

    def _list_is_quiet(self, fetch: ParameterFetch, now_s: float) -> None:
        if fetch.count is None:
            self._send_to(fetch.target, "PARAM_REQUEST_LIST")
            fetch._quiet_s = now_s + QUIET_S
        else:
            fetch._waiting = deque(index for index in range(fetch.count) if index not in fetch._by_index)

    def _request_singly(self, fetch: ParameterFetch, now_s: float) -> None:
        waiting = fetch._waiting
        while waiting and len(fetch._requested_s) < AT_ONCE:
            index = waiting.popleft()
            if index in fetch._by_index:
                continue
            fetch._budget -= 1
            if fetch._budget < 0:
                self._end_fetch(fetch, ParameterResult.TOO_MANY_LOSSES)
                return
            fetch._requested_s[index] = now_s
            self._send_to(fetch.target, "PARAM_REQUEST_READ", param_index=index)

    def _next_fetch_s(self, fetch: ParameterFetch) -> float:
        silent_s = fetch._received_s + SILENT_S
        if fetch._waiting is None:
            return min(fetch._quiet_s, silent_s)
        requested_s = min(fetch._requested_s.values(), default=None)
        return silent_s if requested_s is None else min(requested_s + self._single_timeout_s(fetch), silent_s)

    def _single_timeout_s(self, fetch: ParameterFetch) -> float:
        return max(self._round_trip(fetch.target).timeout_s, QUIET_S / 2)

    def _end_fetch(self, fetch: ParameterFetch, result: ParameterResult) -> None:
        del self._fetches[fetch.target]
        fetch.result = result
        self._events.append(fetch)

    def _known_of(self, sender: Address) -> dict[str, Parameter]:
        """What is known of a sender; one more than there is room for takes that of the first to which nothing was asked."""
        if sender not in self.known and len(self.known) >= MOST_VEHICLES:
            asked = {*self._fetches, *(target for target, _ in self._calls)}
            del self.known[next((one for one in self.known if one not in asked), next(iter(self.known)))]
        return self.known.setdefault(sender, {})

    def _round_trip(self, target: Address) -> RoundTrip:
        return self._round_trips.setdefault(target, RoundTrip())
