"""Reload of the platform file while the platform runs: changeable settings are adopted, other changes are reported."""

import asyncio
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

import msgspec

from gloc3.component.deployment import ComponentRow
from gloc3.component.host import ComponentHost
from gloc3.component.lci import OPERATING, Command, State
from gloc3.component.settings import load_settings
from gloc3.errors import Gloc3Error, InputError
from gloc3.exchange import Publisher, request
from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import CommandRequest, ComponentStatus, Envelope, FunctionRequest, Severity
from gloc3.platform.platform import Platform

REPLY_S: Final = 12.0
"""A component may take 5 s for each of its methods."""
NEXT_START: Final = "takes effect at the next start"

Report = Callable[[Severity, str], None]


class PlatformReload:
    """Compares the file with the running platform, and applies the changes that components may adopt.

    New settings restart a working component, so they are applied on the ground only; in flight they are reported, and
    the next reload on the ground applies them.

    Args:
        platform: the running platform.
        read: reads the file again, in a thread.
        hosts: the components of this process.
        exchange: reaches all components.
        loop: the process's event loop.
        boot: a random number for this start of the process.
        may_stop: whether a working component may be stopped now.
        report: called with messages for people.
    """

    def __init__(
        self,
        platform: Platform,
        read: Callable[[], Platform],
        hosts: Mapping[str, ComponentHost],
        exchange: Exchange,
        loop: asyncio.AbstractEventLoop,
        boot: int,
        may_stop: Callable[[], bool],
        report: Report,
    ) -> None:
        self._begun, self._read, self._hosts, self._exchange, self._loop = platform, read, hosts, exchange, loop
        self._may_stop, self._report = may_stop, report
        self._rows = {row.name: row for row in platform.components}
        """As they are kept now."""
        self._states: dict[str, State | None] = {}
        self._publisher = Publisher(exchange, platform.platform, "reload", boot)
        self._count = 0
        self._base = f"{platform.platform}/components"
        self._unsubscribe = exchange.subscribe(f"{self._base}/*/status", self._receive_status)

    def close(self) -> None:
        """Listens no more."""
        self._unsubscribe()

    async def read_again(self) -> None:
        """Reads the file and applies permitted changes; a file with errors changes nothing."""
        try:
            platform = await self._loop.run_in_executor(None, self._read)  # the loop has a vehicle to fly meanwhile
        except Gloc3Error as error:
            found = error.findings if isinstance(error, InputError) else ()
            for finding in found:
                self._report(Severity.WARNING if finding.is_warning else Severity.ERROR, str(finding))
            if not found:
                self._report(Severity.ERROR, str(error))
            self._report(Severity.ERROR, "the platform file cannot be used: nothing was changed")
            return
        changed = [name for name in _fields(platform, self._begun) if name != "components"]
        rows = {row.name: row for row in platform.components}
        lines = [f"{name}: {NEXT_START}" for name in changed]
        lines += [f"component {name}: {NEXT_START}" for name in sorted(rows.keys() ^ self._rows.keys())]
        for name, row in rows.items():
            if name in self._rows:
                lines += [f"{name}: {text}" for text in await self._adopt(row, self._rows[name])]
        for line in lines:
            self._report(Severity.NOTICE, f"reloaded: {line}")
        if not lines:
            self._report(Severity.NOTICE, "reloaded: nothing has changed")

    def _receive_status(self, envelope: Envelope[ComponentStatus]) -> None:
        self._states[envelope.payload.name] = envelope.payload.state

    async def _adopt(self, new: ComponentRow, previous: ComponentRow) -> list[str]:
        """What became of the changes of one row."""
        said = []
        for field in _fields(new, previous):
            value = getattr(new, field)
            match field:
                case "settings":
                    text = await self._adopt_settings(new)
                case "rate_hz" if new.rate_hz is not None and previous.rate_hz is not None:
                    text = await self._call_function(new.name, "set_rate", {"rate_hz": new.rate_hz})
                case "log":
                    text = await self._call_function(
                        new.name, "set_logging", {"items": new.log, "is_enabled": bool(new.log)}
                    )
                case _:
                    text = NEXT_START
            if not text:
                self._rows[new.name] = msgspec.structs.replace(self._rows[new.name], **{field: value})
            said.append(f"{field}: {text or 'adopted'}")
        return said

    async def _adopt_settings(self, new: ComponentRow) -> str:
        """Has the component initialized with its new settings; an empty text, or why not."""
        state = self._states.get(new.name)
        if state in OPERATING and not self._may_stop():
            return f"it is {state}, and the vehicle is armed or on a mission: reload again on the ground"
        if state in (None, State.IDLE, State.FAULTY):
            if (host := self._hosts.get(new.name)) is None:
                return f"it is {state or 'absent'} in another process: {NEXT_START}"
            host.settings = new.settings
            return ""  # its next `initialize` takes them
        commands: tuple[Command, ...] = (Command.INITIALIZE,)
        if state in OPERATING:
            commands = (Command.STOP, Command.INITIALIZE, Command.START)
        if state is State.QUIET:
            commands = (*commands, Command.GOQUIET)
        first, *then = commands
        settings = msgspec.to_builtins(load_settings(new.load_class().settings_type, new.settings, new.name))
        order = partial(CommandRequest, command=first, then=tuple(then), settings=settings, is_kept=True)
        return await self._order(f"{self._base}/{new.name}/command", order)

    async def _call_function(self, name: str, function: str, arguments: dict[str, Any]) -> str:
        """Has a component do one of its functions; an empty text, or why not."""
        if self._states.get(name) not in OPERATING:
            return f"it is {self._states.get(name) or 'absent'}: {NEXT_START}"
        order = partial(FunctionRequest, function=function, arguments=arguments)
        return await self._order(f"{self._base}/{name}/function", order)

    async def _order(self, topic: str, order: Callable[..., CommandRequest | FunctionRequest]) -> str:
        self._count += 1
        try:
            reply = await request(
                self._exchange, self._publisher, topic, order(request_id=f"reload-{self._count}"), REPLY_S
            )
        except TimeoutError:
            return f"it has not answered within {REPLY_S:g} s"
        return "" if reply.is_accepted else f"refused: {reply.reason}"


def _fields(new: msgspec.Struct, previous: msgspec.Struct) -> list[str]:
    """The names of the fields that differ."""
    return [name for name in new.__struct_fields__ if getattr(new, name) != getattr(previous, name)]
