"""Reads an autopilot's parameters of a preset, sets those that differ, and verifies them: no I/O."""

from collections import deque
from collections.abc import Iterable
from enum import StrEnum
from typing import Final, Never

from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice, earliest
from gloc3.mavlink.services.heartbeat import ARMED, MavlinkPeers
from gloc3.mavlink.services.parameter import ParameterEncoding
from gloc3.mavlink.services.parameter_client import ParameterCall, ParameterClient, ParameterResult
from gloc3.messages.vehicle import Style
from gloc3_onboard.autopilot.families import style_of
from gloc3_onboard.autopilot.presets.files import Preset, PresetChange, diff

AT_ONCE: Final = 4


class PresetStage(StrEnum):
    """Stages of a session."""

    LISTENING = "waiting for the autopilot"
    READING = "reading"
    READ = "read"
    SETTING = "setting"
    VERIFYING = "reading again"
    DONE = "done"
    FAILED = "failed"


class PresetSession(Microservice[Never]):
    """One preset and one autopilot.

    Args:
        own: our MAVLink address.
        preset: the preset.
    """

    def __init__(self, own: Address, preset: Preset) -> None:
        super().__init__(own)
        self.stage = PresetStage.LISTENING
        self.problem = ""
        """Why it failed."""
        self.target: Address | None = None
        self._preset = preset
        self._peers = MavlinkPeers(own)
        self._parameters = ParameterClient(own)
        self.handles = self._peers.handles | self._parameters.handles  # type: ignore[misc] # of two services
        self._waiting: deque[str] = deque()
        self._calls: dict[str, ParameterCall] = {}
        self._now: dict[str, float] = {}
        self._problems: dict[str, str] = {}
        self._refused: list[str] = []

    @property
    def changes(self) -> list[PresetChange]:
        """What the preset means for this vehicle, as far as it has been read."""
        return diff(self._preset, self._now, self._problems)

    def apply(self, now_s: float) -> None:
        """Sets what differs, after it has been read and shown."""
        if self.stage is not PresetStage.READ:
            return
        if self._is_armed:
            self._fail("the vehicle is armed; disarm it to change parameters")
            return
        self.stage = PresetStage.SETTING
        self._waiting = deque(change.name for change in self.changes if change.is_needed)
        self._go_on(now_s)

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Takes a heartbeat or a value in."""
        if message.name in self._peers.handles:
            self._peers.receive(message, sender, now_s)
            self._peers.events()
            if self.stage is PresetStage.LISTENING:
                self._adopt(now_s)
        elif sender == self.target:
            self._parameters.receive(message, sender, now_s)
            self._follow(now_s)

    def tick(self, now_s: float) -> None:
        """Asks again for what stays away."""
        self._peers.tick(now_s)
        self._parameters.tick(now_s)
        self._follow(now_s)

    def next_tick_s(self) -> float | None:
        """When something is due."""
        return earliest(self._parameters.next_tick_s())

    def outgoing(self) -> list[MavlinkMessage]:
        """What it has to say."""
        return self._parameters.outgoing()

    @property
    def _is_armed(self) -> bool:
        return self.target is not None and bool(self._peers[self.target].heartbeat.base_mode & ARMED)

    def _fail(self, problem: str) -> None:
        self.stage, self.problem = PresetStage.FAILED, problem

    def _adopt(self, now_s: float) -> None:
        for peer in self._peers.autopilots:
            style = style_of(peer.heartbeat)
            if style is None:
                continue
            if (style.style, style.class_properties.vehicle) != (self._preset.style, self._preset.vehicle):
                found, meant = f"{style.style} on a {style.class_properties.vehicle}", self._preset
                self._fail(f"the autopilot is {found}; the preset is for {meant.style} on a {meant.vehicle}")
                return
            self.target = peer.address
            encoding = ParameterEncoding.BYTEWISE if style.style is Style.PX4 else ParameterEncoding.CAST
            self._parameters.encoding = encoding
            self._read(PresetStage.READING, self._preset.values(), now_s)
            return

    def _read(self, stage: PresetStage, names: Iterable[str], now_s: float) -> None:
        self.stage = stage
        self._waiting = deque(names)
        self._now.clear()
        self._go_on(now_s)

    def _go_on(self, now_s: float) -> None:
        assert self.target is not None
        while self._waiting and len(self._calls) < AT_ONCE:
            name = self._waiting.popleft()
            if self.stage is PresetStage.SETTING:
                value = self._preset.values()[name]
                self._calls[name] = self._parameters.set(self.target, name, value, now_s=now_s)
            else:
                self._calls[name] = self._parameters.read(self.target, name, now_s=now_s)
        if not self._calls and not self._waiting:
            self._end_stage(now_s)

    def _follow(self, now_s: float) -> None:
        is_moved = False
        for event in self._parameters.events():
            if not isinstance(event, ParameterCall) or self._calls.get(event.name) is not event:
                continue
            is_moved = True
            del self._calls[event.name]
            if event.result is ParameterResult.DONE and event.value is not None:
                self._now[event.name] = event.value.value
            elif self.stage is PresetStage.SETTING:
                self._refused.append(f"{event.name}: {event.result}")
            else:
                self._problems[event.name] = str(event.result)
        if is_moved and self.stage in (PresetStage.READING, PresetStage.SETTING, PresetStage.VERIFYING):
            self._go_on(now_s)

    def _end_stage(self, now_s: float) -> None:
        match self.stage:
            case PresetStage.READING:
                self.stage = PresetStage.READ
            case PresetStage.SETTING:
                self._read(
                    PresetStage.VERIFYING, [one for one in self._preset.values() if one not in self._problems], now_s
                )
            case PresetStage.VERIFYING:
                left = [change.name for change in self.changes if change.is_needed]
                if self._refused or left:
                    self._fail("; ".join(self._refused) or f"the vehicle has other values: {', '.join(left)}")
                else:
                    self.stage = PresetStage.DONE
