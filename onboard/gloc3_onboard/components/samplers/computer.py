"""SS: the onboard computer: room and speed of its disk, its log, its clock, its ports."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from gloc3.component.component import SensorSampler, function
from gloc3.component.ports import Inbox, Output, Result
from gloc3.component.settings import NoSettings
from gloc3.log.selection import TopicChoice
from gloc3.messages.envelope import Message
from gloc3.messages.readiness import ComputerState


class Computer(Protocol):
    """Vital signs of a computer; may be called from any thread, and does not block."""

    def state(self) -> ComputerState:
        """How it is now."""

    def select(self, chosen: Mapping[str, TopicChoice]) -> Mapping[str, TopicChoice]:
        """Changes what its log records; raises `Refused` where a pattern fits no topic."""


class LogTopics(Message, frozen=True):
    """Topics that are recorded differently from their rows, by name or pattern such as `camera/*`."""

    topics: dict[str, TopicChoice] = {}
    """True: all messages; false: none; a number: at most so many a second."""


class ComputerSampler(SensorSampler[NoSettings]):
    """Reports the computer once a cycle."""

    loggable = ("disk_free_mb",)

    computer = Output(ComputerState)

    def __init__(self, device: Computer) -> None:
        self.disk_free_mb = 0.0
        self._device = device

    @function("log_topics")
    def log_topics(self, request: LogTopics, now_s: float) -> LogTopics:
        """Changes what is recorded of some topics until the process ends; answers with all such changes."""
        return LogTopics(topics=dict(self._device.select(request.topics)))

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Looks."""
        state = self._device.state()
        self.disk_free_mb = state.disk_free_mb
        return [state]
