"""Parameters of the onboard computer: rates and settings of its components, changed as by our stations.

A setting applies when its component initializes, so it can be changed in standby (or idle, or faulty); a rate while
working. The command interface server refuses everything else, and its reason is forwarded.
"""

from collections.abc import Callable, Sequence
from typing import Any, Final

import msgspec

from gloc3.component.lci import CREATE, Command
from gloc3.errors import Refused
from gloc3.exchange.base import Exchange
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.parameter import Parameter, ParameterEncoding, parameter
from gloc3.mavlink.services.parameter_server import (
    ParameterChanged,
    ParameterError,
    ParameterRefused,
    ParameterServer,
    ParameterWanted,
)
from gloc3.messages.command_interface import AnyBody, CallFunction, CiReply, CommandComponent, Outcome
from gloc3.messages.envelope import CommandReply, CommandRequest, Envelope, FunctionReply, FunctionRequest
from gloc3.network.rights import MEANINGS
from gloc3.network.rights_file import Right
from gloc3.platform.platform import Platform
from gloc3_onboard.companion.parameter_table import CompanionParameter, OwnParameter, exact, rows_of, setting_value
from gloc3_onboard.companion.pending_requests import PendingRequests

MOST_AWAITED: Final = 64
"""Commands to components with a pending reply, which shows the adopted values."""


class CompanionParameters:
    """Serves parameters.

    Args:
        own: MAVLink address of the server.
        requesting: requests to the command interface server.
        exchange: source of other parties' changes.
        platform: the platform file.
        own_parameters: parameters of the onboard computer itself.
        report: called with the reason of each refusal.
        changed: called when there is something to send.
    """

    def __init__(
        self,
        own: Address,
        requesting: PendingRequests,
        exchange: Exchange,
        platform: Platform,
        own_parameters: Sequence[OwnParameter],
        report: Callable[[str], None],
        changed: Callable[[], None],
    ) -> None:
        self.refused = 0
        """Values that were turned down."""
        self._requesting, self._report, self._changed = requesting, report, changed
        self._apply = {each.row.name: each.apply for each in own_parameters}
        rows = [*(each.row for each in own_parameters), *rows_of(platform.components)]
        self._rows: Final = {row.name: row for row in rows}
        self._names = {(row.component, row.setting): row.name for row in rows}
        self._components = {row.name: row for row in platform.components}
        self._kinds = {
            name: {field.name: field.type for field in msgspec.structs.fields(row.load_class().settings_type)}
            for name, row in self._components.items()
        }
        self._adopted: dict[str, dict[str, Any]] = {}
        """Component to the settings that it has adopted and that are not its row's."""
        self._awaited: dict[str, CommandRequest | FunctionRequest] = {}
        self.server: Final = ParameterServer(
            own,
            [parameter(row.name, row.value) for row in rows],
            encoding=ParameterEncoding.CAST,
            check=self._check,
            leave=self._leave,
        )
        prefix = f"{platform.platform}/components/*"
        self._unsubscribe = [
            exchange.subscribe(f"{prefix}/command", self._requested),
            exchange.subscribe(f"{prefix}/function", self._requested),
            exchange.subscribe(f"{prefix}/reply", self._replied),
            exchange.subscribe(f"{prefix}/function_reply", self._replied),
        ]

    @property
    def rows(self) -> Sequence[CompanionParameter]:
        """Every parameter."""
        return tuple(self._rows.values())

    def close(self) -> None:
        """Hears nothing any more."""
        for unsubscribe in self._unsubscribe:
            unsubscribe()

    def tick(self) -> None:
        """Carries out requested changes."""
        for event in self.server.events():
            match event:
                case ParameterWanted():
                    self._set(event)
                case ParameterChanged(parameter=changed):
                    self._apply[changed.name](exact(changed.value))

    # --- from the wire ---

    def _check(self, wanted: Parameter) -> None:
        problem = self._rows[wanted.name].problem(exact(wanted.value))
        if problem:
            self.refused += 1
            self._report(f"parameter refused: {problem}")
            raise Refused(problem)

    def _leave(self, wanted: ParameterWanted) -> bool:
        row, system = self._rows[wanted.parameter.name], wanted.sender.system
        try:
            self._requesting.require(system)
            if not row.component and not self._requesting.may(system, Right.MAINTAIN):
                raise Refused(f"{MEANINGS[Right.MAINTAIN]} needs the role maintainer")
        except Refused as refusal:
            self.refused += 1
            self._report(f"parameter {row.name} of station {system} refused: {refusal}")
            raise ParameterRefused(str(refusal), ParameterError.PERMISSION_DENIED) from None
        return bool(row.component)

    def _set(self, wanted: ParameterWanted) -> None:
        row, value = self._rows[wanted.parameter.name], wanted.parameter.value

        def ended(reply: CiReply) -> None:
            if reply.outcome is Outcome.ACCEPTED:
                self.server.conclude(wanted, None)
            else:
                self._refuse(wanted, reply.reason)

        try:
            self._requesting.act(wanted.sender, self._body(row, value), ended)
        except Refused as refusal:
            self._refuse(wanted, str(refusal))

    def _refuse(self, wanted: ParameterWanted, reason: str) -> None:
        self.refused += 1
        self._report(f"parameter {wanted.parameter.name} of station {wanted.sender.system} refused: {reason}")
        self.server.conclude(wanted, ParameterError.PERMISSION_DENIED)

    def _body(self, row: CompanionParameter, value: float) -> AnyBody:
        if not row.setting:
            return CallFunction(component=row.component, function="set_rate", arguments={"rate_hz": exact(value)})
        changed = {row.setting: setting_value(row, value, self._kinds[row.component])}
        settings = {**self._adopted.get(row.component, {}), **changed}
        return CommandComponent(component=row.component, command=Command.INITIALIZE, settings=settings)

    # --- what anybody has changed ---

    def _requested(self, envelope: Envelope[CommandRequest | FunctionRequest]) -> None:
        request = envelope.payload
        is_rate = isinstance(request, FunctionRequest) and request.function == "set_rate"
        is_command = isinstance(request, CommandRequest) and request.command in (Command.INITIALIZE, CREATE)
        if is_rate or is_command:
            self._awaited[request.request_id] = request
            if len(self._awaited) > MOST_AWAITED:
                del self._awaited[next(iter(self._awaited))]

    def _replied(self, envelope: Envelope[CommandReply | FunctionReply]) -> None:
        reply = envelope.payload
        request = self._awaited.pop(reply.request_id, None)
        if request is None or not reply.is_accepted or reply.component not in self._components:
            return
        if isinstance(request, FunctionRequest):
            self._send_value(reply.component, "", request.arguments.get("rate_hz"))
            return
        row = self._components[reply.component]
        if request.command == CREATE:
            self._send_value(reply.component, "", row.rate_hz)
        self._adopted[reply.component] = dict(request.settings or {})
        adopted = {**row.settings, **(request.settings or {})}
        for component, setting in list(self._names):
            if component == reply.component and setting:
                default = self._rows[self._names[component, setting]].value
                self._send_value(component, setting, adopted.get(setting, default))

    def _send_value(self, component: str, setting: str, value: Any) -> None:
        name = self._names.get((component, setting))
        if name is not None and isinstance(value, bool | int | float):
            now = parameter(name, float(value))
            if not now.is_same(parameter(name, self.server[name])):
                self.server.set(name, float(value))
                self._changed()
