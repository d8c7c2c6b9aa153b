"""Components for tests: they keep a diary of what their host calls, and raise what the diary tells them to."""

from collections.abc import Callable, Sequence
from typing import Annotated, Any

import msgspec

from gloc3.component.component import ActuatorDriver, DataProcessor, function
from gloc3.component.deployment import ComponentRow
from gloc3.component.ports import Actuation, Inbox, Input, Keep, Output, Result
from gloc3.component.settings import Bounds, Settings
from gloc3.errors import Refused
from gloc3.messages.envelope import Message
from gloc3.messages.topics import TopicRow, TopicTable


class Number(Message, frozen=True):
    """A number on its way."""

    value: float


class Scale(Message, frozen=True):
    """Asks for another factor."""

    factor: Annotated[float, msgspec.Meta(ge=-10.0, le=10.0)]


class Scaled(Message, frozen=True):
    """The factor that was in force before."""

    before: float


class SpecimenSettings(Settings, frozen=True):
    """What a specimen can be set to."""

    offset: Annotated[float, Bounds(-100.0, 100.0)] = 0.0
    """Added to what comes in, in whatever it is in."""


class Diary:
    """What was called, in order, over all the lives of a component; and what is to be raised."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.errors: dict[str, BaseException] = {}
        """Method to what it raises."""
        self.acts: dict[str, Callable[[], Any]] = {}
        """Method to what it does besides."""
        self.writes: list[Any] = []
        self.made = 0

    def note(self, method: str) -> None:
        """Writes a call down, and raises what is ordered."""
        self.calls.append(method)
        if method in self.acts:
            self.acts[method]()
        if method in self.errors:
            raise self.errors[method]

    def methods(self) -> list[str]:
        """The calls of the state machine's methods, without the cycles."""
        return [call for call in self.calls if call != "work"]


class _Noting:
    """The methods of the state machine, written down."""

    def __init__(self, diary: Diary) -> None:
        diary.note("__init__")
        diary.made += 1
        self.diary = diary
        self.number = diary.made

    def initialize(self, settings: SpecimenSettings) -> None:
        self.offset = settings.offset
        self.diary.note("initialize")

    def start(self) -> None:
        self.diary.note("start")

    def goquiet(self) -> None:
        self.diary.note("goquiet")

    def resume(self) -> None:
        self.diary.note("resume")

    def stop(self) -> None:
        self.diary.note("stop")

    def finish(self) -> None:
        self.diary.note("finish")


class Specimen(_Noting, DataProcessor[SpecimenSettings]):
    """Gives what comes in, times a factor, plus an offset."""

    loggable = ("factor", "cycles", "broken", "table")

    given = Input(Number)
    every = Input(Number, keep=Keep.ALL, depth=4)
    result = Output(Number)

    factor = 1.0
    cycles = 0
    results: Sequence[Any] | None = None
    """What `work()` returns instead."""

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        self.cycles += 1
        self.diary.note("work")
        if self.results is not None:
            return self.results
        latest = inbox.latest(self.given)
        return [Number(value=self.factor * (latest.payload.value if latest else now_s) + self.offset)]

    @property
    def broken(self) -> float:
        raise ValueError("nothing to see here")

    @property
    def table(self) -> dict[int, tuple[float, ...]]:
        return {1: (1.0, 2.0)}

    @function("scale")
    def scale(self, request: Scale, now_s: float) -> Scaled:
        """Sets the factor."""
        self.diary.note("scale")
        if request.factor == 0.0:
            raise Refused("a factor of 0 is of no use")
        before, self.factor = self.factor, request.factor
        return Scaled(before=before)


class Driver(_Noting, ActuatorDriver[SpecimenSettings]):
    """Writes the time to its device, once a cycle."""

    done = Output(Number)

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        self.diary.note("work")
        return [Actuation(now_s), Number(value=now_s)]

    def actuate(self, write: Any) -> None:
        self.diary.note("actuate")
        self.diary.writes.append(write)

    def make_safe(self) -> None:
        self.diary.note("make_safe")

    def check_leaving(self) -> None:
        self.diary.note("check_leaving")

    @function("nudge")
    def nudge(self, request: Scale, now_s: float) -> Scaled:
        """Fails if the diary says so."""
        self.diary.note("nudge")
        return Scaled(before=0.0)


def row(name: str = "specimen", **entries: Any) -> ComponentRow:
    """A row of a deployment, at 10 Hz if nothing else is said."""
    entries.setdefault("rate_hz", 10.0)
    return ComponentRow(name=name, class_name="tests:Specimen", **entries)


def topics() -> TopicTable:
    """The topics of the specimens."""
    return TopicTable({"given": TopicRow(Number, 10.0), "result": TopicRow(Number, 10.0)})
