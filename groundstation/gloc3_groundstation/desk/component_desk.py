"""Requests to a component: the commands that its state allows, and its typed functions."""

import re
from collections.abc import Mapping
from typing import Any, Final

import msgspec

from gloc3.component.component import FunctionEntry
from gloc3.component.functions import GENERIC
from gloc3.component.lci import CREATE, TABLE, Command, State, allowed
from gloc3.documents.schema import in_words
from gloc3.errors import UNREADABLE, Gloc3Error, Refused
from gloc3.messages.command_interface import FORCE, AnyBody, CallFunction, CommandComponent, Outcome
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import WELL, Health
from gloc3.mission.model.model import Policies
from gloc3_groundstation.desk import flights
from gloc3_groundstation.missions.plans import known_platform
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.data_chain import Wiring
from gloc3_groundstation.station.snapshots import ComponentSnapshot, PlatformSnapshot
from gloc3_groundstation.station.station import Station

POSE: Final = "pose"
"""The topic on which a vehicle's movement rests."""


class ComponentReply(msgspec.Struct, frozen=True, kw_only=True):
    """Result of a request to a component."""

    requested: str
    """`initialize`, `set_rate`."""
    is_accepted: bool
    text: str
    """The reply in words: the state that followed, a function's result, or the reason of a refusal."""
    received_s: float
    can_be_forced: bool = False
    """Refused since a running action needs the component; forced, the action fails by its policy."""


class ComponentDesk:
    """Sends requests to components through their platform; the result is kept as the component's last answer."""

    def __init__(self, station: Station) -> None:
        self._station = station
        self._answers: dict[tuple[str, str], ComponentReply] = {}
        self._functions: dict[tuple[str, str], tuple[FunctionEntry, ...]] = {}
        self._wirings: dict[tuple[str, tuple[str, ...]], Wiring | None] = {}

    def answer(self, platform: str, component: str) -> ComponentReply | None:
        """Reply to the last request to a component."""
        return self._answers.get((platform, component))

    # --- commands ---

    @staticmethod
    def commands(component: ComponentSnapshot) -> dict[str, str]:
        """Commands that a component's state allows, with the consequences of each; none while the state is unknown."""
        if component.health is None:
            return {}
        if component.health is Health.ABSENT:
            return {CREATE: "its host restarts it"}
        state = State(component.health.value)
        return {command.value: _effect(state, command) for command in allowed(state)}

    def harm(self, platform: PlatformSnapshot, name: str, policies: Policies | None) -> str:
        """What follows if a component stops working now; empty where it is not required, or nothing is armed.

        Args:
            platform: the vehicle.
            name: of the component.
            policies: of the loaded mission; None while they are not known.
        """
        components = platform.components(self._station.now_s())
        component = next((one for one in components if one.name == name), None)
        if (
            component is None
            or not platform.is_armed
            or not component.is_required
            or component.health is not Health.WORKING
        ):
            return ""
        wiring = self.wiring(platform.name)
        is_pose = POSE in wiring.gives(name) if wiring is not None else name == POSE
        return wording.without_component(component, components, is_pose=is_pose, policies=policies)

    async def command(self, platform: str, component: str, command: str, *, is_forced: bool = False) -> ComponentReply:
        """Requests control, then commands a component's LCI."""
        body = CommandComponent(component=component, command=command, is_forced=is_forced)
        return await self._request(platform, component, command, body)

    # --- functions ---

    def functions(self, platform: str, component: ComponentSnapshot) -> tuple[FunctionEntry, ...]:
        """Functions of a component in its present state: the common ones, and its own where it is known."""
        if component.health not in WELL:
            return ()
        key = platform, component.name
        if key not in self._functions:
            self._functions[key] = (*self._own_functions(*key), *GENERIC.values())
        return self._functions[key]

    async def call(
        self, platform: str, component: str, entry: FunctionEntry, texts: Mapping[str, str]
    ) -> ComponentReply:
        """Requests control, then sends a function message.

        Args:
            platform: the component's platform.
            component: its name.
            entry: the function.
            texts: argument to the typed text.

        Raises:
            Refused: the arguments do not fit.
        """
        body = CallFunction(component=component, function=entry.name, arguments=arguments(entry, texts))
        return await self._request(platform, component, entry.name, body)

    def wiring(self, platform: str) -> Wiring | None:
        """Connections between components; None where the platform's file is not installed here."""
        key = platform, self._names(platform)
        if key not in self._wirings:
            try:
                known = known_platform(*key)
            except Gloc3Error:
                known = None
            self._wirings[key] = None if known is None else Wiring.of(known)
        return self._wirings[key]

    def _names(self, platform: str) -> tuple[str, ...]:
        received = self._station.fleet.get(platform)
        return received.component_names if received is not None else ()

    def _own_functions(self, platform: str, component: str) -> tuple[FunctionEntry, ...]:
        try:
            known = known_platform(platform, self._names(platform))
            row = next((row for row in known.components if row.name == component), None) if known is not None else None
            own = row.load_class().functions.values() if row is not None else ()
        except Gloc3Error:
            return ()
        return tuple(entry for entry in own if not entry.name.startswith("action."))

    async def _request(self, platform: str, component: str, what: str, body: AnyBody) -> ComponentReply:
        try:
            await flights.request_control(self._station, platform)
            reply = await self._station.client.request(platform, body)
        except Gloc3Error as error:
            is_accepted, text = False, str(error)
        else:
            is_accepted = reply.outcome is Outcome.ACCEPTED
            result = ", ".join(f"{name} {_spell(value)}" for name, value in reply.result.items())
            text = (result or reply.reason or "done") if is_accepted else f"{reply.outcome}: {reply.reason}"
        answer = ComponentReply(
            requested=what,
            is_accepted=is_accepted,
            text=text,
            received_s=self._station.now_s(),
            can_be_forced=not is_accepted and FORCE in text,
        )
        self._answers[platform, component] = answer
        severity = Severity.INFO if is_accepted else Severity.ERROR
        self._station.note(platform, severity, f"{component}: {what}: {text}")
        return answer


def arguments(entry: FunctionEntry, texts: Mapping[str, str]) -> dict[str, Any]:
    """Parses the texts typed for a function's arguments; an empty one keeps its default.

    Raises:
        Refused: an argument is missing or invalid; the reason names it.
    """
    values = {name: _value(text) for name, text in texts.items() if text.strip()}
    fields = {field.encode_name: field for field in msgspec.structs.fields(entry.request)}
    for name, value in list(values.items()):
        if name in fields and isinstance(value, str) and "list" in str(fields[name].type):
            values[name] = [part.strip() for part in value.split(",") if part.strip()]
    missing = [name for name, field in fields.items() if field.required and name not in values]
    if missing:
        raise Refused(f"{', '.join(missing)} must be given")
    try:
        checked = msgspec.convert(values, entry.request, strict=False)
    except msgspec.ValidationError as error:
        where = re.search(r"`\$\.([^`]+)`$", str(error))
        raise Refused(f"{where[1]}: {in_words(error)}" if where else in_words(error)) from None
    return {name: msgspec.to_builtins(getattr(checked, fields[name].name)) for name in values}


def _value(text: str) -> Any:
    """Parses text: JSON if it begins like a list or object; else text, converted to a number where required."""
    text = text.strip()
    if text[0] in '[{"':
        try:
            return msgspec.json.decode(text)
        except UNREADABLE as error:
            raise Refused(f"{text!r} is no JSON: {error}") from None
    return {"yes": "true", "no": "false"}.get(text.lower(), text)


def _effect(state: State, command: Command) -> str:
    to = TABLE[state][command].to
    return f"then {to}" if to is not None else "leaves the system"


def _spell(value: object) -> str:
    return ", ".join(map(str, value)) or "none" if isinstance(value, list) else str(value)
