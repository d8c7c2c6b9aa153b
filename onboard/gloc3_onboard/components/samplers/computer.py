"""SS: the onboard computer: room and speed of its disk, its log, its clock, its ports."""

from collections.abc import Sequence
from typing import Protocol

from gloc3.component.component import SensorSampler
from gloc3.component.ports import Inbox, Output, Result
from gloc3.component.settings import NoSettings
from gloc3.messages.readiness import ComputerState


class Computer(Protocol):
    """Vital signs of a computer; may be called from any thread, and does not block."""

    def state(self) -> ComputerState:
        """How it is now."""


class ComputerSampler(SensorSampler[NoSettings]):
    """Reports the computer once a cycle."""

    loggable = ("disk_free_mb",)

    computer = Output(ComputerState)

    def __init__(self, device: Computer) -> None:
        self.disk_free_mb = 0.0
        self._device = device

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Looks."""
        state = self._device.state()
        self.disk_free_mb = state.disk_free_mb
        return [state]
