"""Messages for the tests of the log: a sample of any type, and a small log."""

import io
import types
import typing
from collections.abc import Mapping, Sequence
from enum import Enum
from random import Random
from typing import Any

import msgspec

from gloc3.clock import Clock, VirtualLoop
from gloc3.component.lci import State
from gloc3.log.record import Recorder
from gloc3.log.selection import TopicChoice
from gloc3.messages.envelope import ComponentStatus, Envelope, Event, Kind, Message, Severity, Source
from gloc3.messages.frames import Vector3
from gloc3.messages.standard_topics import TOPICS
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import HeightAboveGround, Home, MotionLimits, Pose
from gloc3.messages.wire import type_name
from gloc3.mission.model.fence import Area, Fence

NUMBERS = (0.0, -0.0, 0.1 + 0.2, -1e-9, 1.0, 123456.789, 1e300, 5e-324, 2.0 / 3.0)
WORDS = ("", "sweep.wall", "null", 'a "quoted" word', "Überlauf ×", "line\nbreak", "\x00", "\\")


def sample(kind: Any, random: Random) -> Any:
    """A value of any type that a message may hold."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if kind is Any:
        return random.choice([1, "text", 0.5, None, True, [1, 2], {"a": [0.25, None]}])
    if origin is typing.Annotated:
        return sample(arguments[0], random)
    if origin in (typing.Union, types.UnionType):
        return sample(random.choice(arguments), random)
    if origin is typing.Literal:
        return random.choice(arguments)
    if origin is list:
        return [sample(arguments[0], random) for _ in range(random.randrange(4))]
    if origin is tuple and arguments[-1] is Ellipsis:
        return tuple(sample(arguments[0], random) for _ in range(random.randrange(4)))
    if origin is tuple:
        return tuple(sample(argument, random) for argument in arguments)
    if origin is dict:
        return {str(sample(str, random)): sample(arguments[1], random) for _ in range(random.randrange(4))}
    return _scalar(kind, random)


def _scalar(kind: Any, random: Random) -> Any:
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return kind(**{field.name: sample(field.type, random) for field in msgspec.structs.fields(kind)})
    if isinstance(kind, type) and issubclass(kind, Enum):
        return random.choice(list(kind))
    choices: dict[Any, Sequence[Any]] = {
        float: NUMBERS,
        int: (0, 1, -7, 2**32 - 1, 2**53 + 1),
        str: WORDS,
        bool: (True, False),
        bytes: (b"", b"\x00\xff\xfd", bytes(range(256))),
        type(None): (None,),
    }
    return random.choice(choices[kind])


class LogInMemory:
    """A recorder in virtual time that writes to memory."""

    def __init__(self, topics: TopicTable | None = None, chosen: Mapping[str, TopicChoice] | None = None) -> None:
        self.loop = VirtualLoop()
        self.stream = io.BytesIO()
        self.recorder = Recorder(
            self.stream, Clock(self.loop), topics or TopicTable(TOPICS), {"platform": "pelican"}, chosen=chosen
        )
        self.sent: list[Envelope[Any]] = []
        self.sequences: dict[tuple[str, Source], int] = {}

    def send(self, topic: str, message: Message, t_s: float, source: Source, frame: str = "") -> Envelope[Any]:
        """Records a message at its time of validity."""
        self.loop._now_s = max(t_s, self.loop.time())
        envelope = self.envelope(topic, message, t_s, source, frame)
        self.recorder.record(envelope)
        self.recorder.flush(self.loop.time())
        self.sent.append(envelope)
        return envelope

    def envelope(self, topic: str, message: Message, t_s: float, source: Source, frame: str = "") -> Envelope[Any]:
        """A message that has not been recorded yet."""
        sequence = self.sequences.get((topic, source), 0)
        self.sequences[topic, source] = sequence + 1
        kind = type_name(type(message))
        return Envelope(f"pelican/{topic}", source, sequence, t_s, frame, kind, message)

    def close(self) -> bytes:
        """Finishes the log; returns its bytes."""
        self.recorder.close()
        self.loop.close()
        return self.stream.getvalue()


POSE = Source("pelican", "pose", 1)
HEIGHT = Source("pelican", "height", 2)


def tiny_log() -> bytes:
    """A log of one topic in three chunks, small enough to try every byte of it."""
    log = LogInMemory()
    for index in range(6):
        log.send("height", HeightAboveGround(height_m=1.5, is_valid=True), 0.15 * index, HEIGHT)
    return log.close()


def small_log(messages: int = 12, *, is_closed: bool = True) -> tuple[bytes, list[Envelope[Any]]]:
    """A log of three topics and several chunks, and what was recorded in it."""
    log = LogInMemory()
    for index in range(messages):
        t_s = 0.1 * index
        pose = Pose(
            position_ned_m=(t_s, 2.0 * t_s, -1.5), velocity_ned_m_s=(1.0, 2.0, 0.0), ned_from_frd=(1.0, 0.0, 0.0, 0.0)
        )
        log.send("pose", pose, t_s, POSE, "ned")
        if index % 3 == 0:
            log.send("height", HeightAboveGround(height_m=1.5, is_valid=True), t_s, HEIGHT)
    event = Event(severity=Severity.ERROR, text="working -> faulty: ValueError")
    log.send("components/pose/event", event, 0.1 * messages, POSE)
    if is_closed:
        return log.close(), log.sent
    log.recorder.flush(1e9)
    data = log.stream.getvalue()
    log.close()
    return data, log.sent


REQUESTED: list[Vector3] = [(0.0, 0.0, 0.0), (0.0, 0.0, -1.5), (4.0, 0.0, -1.5), (4.0, 2.0, -1.5), (0.0, 0.0, -1.5)]
FENCE = Fence(
    area=Area(polygon_ne_m=((-1.0, -1.0), (6.0, -1.0), (6.0, 4.0), (-1.0, 4.0))),
    keep_out=(Area(center_ne_m=(5.0, 3.0), radius_m=0.5),),
    ceiling_m=8.0,
)


def flight_log() -> bytes:
    """A short flight along `REQUESTED`: poses, home at 0.5 s, one component faulty from 2 s to 3 s, one quiet."""
    log = LogInMemory()
    log.recorder.write_metadata("mission", {"name": "round", "text": "mission: round"})
    log.recorder.write_requested_path(REQUESTED)
    limits = MotionLimits(
        speed_m_s=1.0, climb_m_s=1.0, acceleration_m_s2=1.0, height_min_m=0.3, height_max_m=8.0, fence=FENCE
    )
    server, camera = Source("pelican", "server", 3), Source("pelican", "camera", 4)
    log.send("motion/limits", limits, 0.0, server)
    for source in (POSE, server, camera):
        _status(log, source, State.IDLE, 0.0)
    for index in range(81):
        t_s = 0.1 * index
        here, there = REQUESTED[index // 20], REQUESTED[min(index // 20 + 1, 4)]
        share = index % 20 / 20.0
        place: Any = tuple(a + (b - a) * share for a, b in zip(here, there, strict=True))
        pose = Pose(position_ned_m=place, velocity_ned_m_s=(0.0, 0.0, 0.0), ned_from_frd=(1.0, 0.0, 0.0, 0.0))
        log.send("pose", pose, t_s, POSE, "ned")
        if index == 5:
            log.send("motion/home", Home(position_ned_m=(0.0, 0.1, 0.0)), t_s, server)
        if index == 2:
            for source, state in ((POSE, State.WORKING), (server, State.QUIET), (camera, State.WORKING)):
                _status(log, source, state, t_s)
        if index == 20:
            fault = Event(severity=Severity.ERROR, text="working -> faulty: OSError: no frame")
            log.send("components/camera/event", fault, t_s, camera)
            _status(log, camera, State.FAULTY, t_s)
        if index == 30:
            log.send("components/camera/event", Event(severity=Severity.INFO, text="start"), t_s, camera)
            _status(log, camera, State.WORKING, t_s)
    _status(log, camera, None, 8.0)
    return log.close()


def _status(log: LogInMemory, source: Source, state: State | None, t_s: float) -> None:
    status = ComponentStatus(name=source.component, kind=Kind.SAMPLER, state=state)
    log.send(f"components/{source.component}/status", status, t_s, source)
