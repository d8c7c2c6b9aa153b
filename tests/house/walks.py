"""`docs/walks.md`: six paths through the code, each a list of functions made by running it in a flight.

A walk is a short list of milestones: functions that something passes one after the other, from a thread of control to the
next. While a flight runs, a tracer notes the stack of calls at the first call of each milestone after the one before; the
walk is the union of the stacks, in order. What only a flight has (its fault injection and its clock) is left out.
"""

import ast
import asyncio
import sys
import threading
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from pkgutil import resolve_name
from tempfile import TemporaryDirectory
from types import CodeType, FrameType, TracebackType
from typing import Any, Final, NamedTuple, Self

from tests.flight.test_mission_screen_in_flight import Operator, PatientLoop
from tests.house.measure import PACKAGES, functions_of, read_modules

from gloc3.clock import run_virtual
from gloc3.messages.command_interface import CiRequest
from gloc3.messages.envelope import ComponentStatus
from gloc3.messages.perception import Features, Odometry
from gloc3.messages.summaries import Summary
from gloc3.messages.vehicle import Image, Pose, Setpoint
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.missions.plans import read_plan
from gloc3_groundstation.tui.app import StationApp
from gloc3_groundstation.tui.screens.health import HealthScreen
from gloc3_groundstation.tui.screens.mission import MissionScreen
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import FlightPlan

ROOT: Final = Path(__file__).parents[2]
PAGE: Final = ROOT / "docs" / "walks.md"
HARNESS: Final = ("gloc3.clock", "gloc3.mavlink.transport.memory", "gloc3_sitl.faults", "gloc3_sitl.flight")
"""What a flight has instead of the world: the virtual clock's loop, links in memory, faults, and the flight itself."""
WITHIN_S: Final = 60.0
HEAD: Final = """\
# Walks

Six paths through the code. Each was recorded in a flight that passed the walk's numbered milestones in order; listed are
the functions on the call stack at each of them. Parts that exist only in virtual time are left out: its clock, its links
in memory (a real link has its transport there), fault injection, and the flight itself. `make docs` writes this page, and
a test repeats some of the walks and compares.
"""


class Milestone(NamedTuple):
    """A function that a walk passes."""

    function: str
    """Its qualified name."""
    message: type | None = None
    """Only a call counts that is given a message of this type, bare or in an envelope."""


class Walk(NamedTuple):
    """A way through the code."""

    title: str
    about: str
    milestones: tuple[Milestone, ...]
    most_files: int | None = None
    """How many files it may pass."""


def _walk(title: str, about: str, most_files: int | None, *milestones: str | tuple[str, type]) -> Walk:
    made = (Milestone(each) if isinstance(each, str) else Milestone(*each) for each in milestones)
    return Walk(title, about, tuple(made), most_files)


ON_THE_LINK: Final = (
    "gloc3.mavlink.transport.memory.MemoryEnd.send",
    "gloc3_onboard.companion.station_link.StationLink.receive_frames",
)
WALKS: Final = {
    "status": _walk(
        "Status to pixel",
        "A component's status, from the component to the row of the health screen.",
        25,
        "gloc3.component.hosted.HostedComponent.status",
        ("gloc3.component.cycle.Mailbox.put", ComponentStatus),
        "gloc3_onboard.command_server.component_book.ComponentBook.receive",
        "gloc3_onboard.command_server.component_book.ComponentBook.summary",
        ("gloc3.exchange.tunnel.status.StatusSender.offer", Summary),
        "gloc3.exchange.tunnel.status.SummaryPacker.next_body",
        "gloc3.exchange.tunnel.frames.SummaryRows.encode",
        "gloc3.mavlink.transport.memory.MemoryEnd.send",
        "gloc3_groundstation.links.link.StationLinkCore.receive",
        "gloc3.exchange.tunnel.status.unpack_summary",
        "gloc3_groundstation.station.fleet._summary",
        "gloc3_groundstation.tui.views.components._cell",
        "gloc3_groundstation.tui.widgets.panel.ListPanel.show_rows",
        "gloc3_groundstation.tui.widgets.panel.Panel.render_line",
    ),
    "setpoint": _walk(
        "Setpoint to bytes",
        "A setpoint, from the controller that follows waypoints to the bytes on the autopilot's line.",
        20,
        "gloc3_onboard.components.controllers.waypoints.WaypointsController._target",
        ("gloc3.component.cycle.Mailbox.put", Setpoint),
        "gloc3_onboard.components.controllers.limiter.Limiter._limit",
        "gloc3_onboard.algorithms.paths.motion_limits.SetpointLimiter.limit",
        ("gloc3.component.cycle.Mailbox.put", Setpoint),
        "gloc3_onboard.components.drivers.setpoint_stream.SetpointStream._convert",
        "gloc3_onboard.autopilot.device.AutopilotDevice.send_setpoint",
        "gloc3_onboard.autopilot.setpoints.setpoint_message",
        "gloc3.mavlink.message.MessageLayout.encode",
        "gloc3.mavlink.transport.memory.MemoryEnd.send",
    ),
    "picture": _walk(
        "Picture to ODOMETRY",
        "A pair of pictures, from the camera to the ODOMETRY message on the autopilot's line.",
        None,
        "gloc3_onboard.components.samplers.stereo_camera.StereoCameraSampler.work",
        ("gloc3.component.cycle.Mailbox.put", Image),
        "gloc3_onboard.algorithms.vision.features.FeatureMatcher.update",
        "gloc3_onboard.algorithms.vision.lucas_kanade.PatchTracker.find",
        "gloc3_onboard.algorithms.vision.stereo_match.StereoMatcher.match",
        ("gloc3.component.cycle.Mailbox.put", Features),
        "gloc3_onboard.algorithms.vision.stereo_motion.StereoMotion._fit",
        ("gloc3.component.cycle.Mailbox.put", Odometry),
        "gloc3_onboard.algorithms.fusion.odometers.Odometers.measure",
        "gloc3_onboard.algorithms.fusion.pose_fusion.PoseFusion.pose",
        ("gloc3.component.cycle.Mailbox.put", Pose),
        "gloc3_onboard.components.drivers.vision_pose.VisionPoseDriver.work",
        "gloc3_onboard.autopilot.vision.odometry_message",
        "gloc3.mavlink.message.MessageLayout.encode",
        "gloc3.mavlink.transport.memory.MemoryEnd.send",
    ),
    "pause": _walk(
        "Pause key to executor",
        "The key `p` on the mission screen, until the executor has paused the mission.",
        20,
        "gloc3_groundstation.tui.screens.mission.MissionScreen.action_steer",
        "gloc3_groundstation.station.command_client.CommandClient.steer",
        ("gloc3.exchange.tunnel.endpoint.TunnelEndpoint.publish", CiRequest),
        "gloc3.exchange.tunnel.frames.Data.encode",
        *ON_THE_LINK,
        "gloc3.exchange.tunnel.frames.Data.decode",
        ("gloc3.component.cycle.Mailbox.put", CiRequest),
        "gloc3_onboard.command_server.mission_commands.MissionCommands.steer",
        "gloc3.mission.executing.executor.MissionExecutor.steer",
        "gloc3.mission.executing.assignments.Assignments.pause",
    ),
    "mission": _walk(
        "Mission file to running task",
        "A mission's file, read and checked on the ground, streamed, checked and loaded onboard, and started.",
        18,
        "gloc3_groundstation.missions.plans.read_plan",
        "gloc3.mission.reading.reader.inspect_mission",
        "gloc3_groundstation.station.command_client.CommandClient.upload",
        ("gloc3.exchange.tunnel.endpoint.TunnelEndpoint.publish", CiRequest),
        "gloc3.exchange.tunnel.frames.Data.encode",
        *ON_THE_LINK,
        "gloc3.exchange.tunnel.frames.Data.decode",
        ("gloc3.component.cycle.Mailbox.put", CiRequest),
        "gloc3.mission.reading.reader.inspect_mission",
        "gloc3.mission.executing.executor.MissionExecutor.load",
        "gloc3_groundstation.station.command_client.CommandClient.steer",
        "gloc3.mission.executing.flow.start_mission",
        "gloc3.mission.executing.flow._start_action",
        "gloc3.mission.executing.items.MissionItem.move",
    ),
    "record": _walk(
        "Record to disk",
        "A component's message, from its cycle to the log's file.",
        None,
        "gloc3.component.outlets.Outlets.route",
        "gloc3.component.hosted.HostedComponent._publish_results",
        "gloc3.log.record.Recorder.record",
        "gloc3.log.payloads.PayloadEncoder.encode",
        "gloc3.log.writer.McapWriter.append",
        "gloc3.log.writer.McapWriter._write_chunk",
        "gloc3.log.writer.McapWriter._write",
    ),
}
"""The milestones of all walks, in the order of the page."""


class Function(NamedTuple):
    """A function that a walk passes."""

    module: str
    name: str

    def __str__(self) -> str:
        return f"{self.module}.{self.name}"


class Tracer:
    """Notes a walk's stacks while it is on, in this thread and in those that are started meanwhile.

    Raises:
        AttributeError: a milestone has another name by now.
    """

    def __init__(self, walk: Walk) -> None:
        self._left = [(each, _code(resolve_name(each.function))) for each in walk.milestones]
        self.is_begun = False
        """From when the milestones count."""
        self.stacks: Final[list[list[Function]]] = []
        """Of the milestones that were passed, the outermost function first."""

    def __enter__(self) -> Self:
        sys.setprofile(self._note)
        threading.setprofile(self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        sys.setprofile(None)
        threading.setprofile(None)

    @property
    def next(self) -> str:
        """The milestone that is waited for; empty at the end."""
        return self._left[0][0].function if self._left else ""

    async def end(self) -> list[list[Function]]:
        """Waits until all milestones were passed.

        Raises:
            TimeoutError: one was not, which is named.
        """
        try:
            async with asyncio.timeout(WITHIN_S):
                while self._left:
                    await asyncio.sleep(0.05)
        except TimeoutError:
            raise TimeoutError(f"{self.next} was not called within {WITHIN_S:g} s") from None
        return self.stacks

    def _note(self, frame: FrameType, event: str, argument: object) -> None:
        if event != "call" or not self.is_begun or not self._left:
            return
        milestone, code = self._left[0]
        if frame.f_code is code and (milestone.message is None or _is_given(frame, milestone.message)):
            del self._left[0]
            self.stacks.append(list(_stack(frame)))


def _code(function: Any) -> CodeType:
    if isinstance(function, property):
        function = function.fget
    found: CodeType = function.__code__
    return found


def _is_given(frame: FrameType, message: type) -> bool:
    """Whether an argument is such a message, or an envelope with one."""
    return any(isinstance(getattr(value, "payload", value), message) for value in frame.f_locals.values())


def _stack(frame: FrameType) -> list[Function]:
    """The functions of the four packages from the outermost to this one, without the harness."""
    found: list[Function] = []
    at: FrameType | None = frame
    while at is not None:
        module = str(at.f_globals.get("__name__", ""))
        if module.partition(".")[0] in PACKAGES and not f"{module}.".startswith(tuple(f"{each}." for each in HARNESS)):
            found.append(Function(module, _name(at.f_code)))
        at = at.f_back
    return found[::-1]


def _name(code: CodeType) -> str:
    """A function's name within its module; what has none counts as the function around it."""
    parts = [part for part in code.co_qualname.split(".") if part != "<locals>"]
    while len(parts) > 1 and parts[-1].startswith("<"):
        parts.pop()
    return ".".join(parts)


# --- the flights ---


async def _setpoint(tracer: Tracer) -> None:
    async with Flight(FlightPlan(mission="inspection")) as flight:
        await flight.upload_and_start()
        tracer.is_begun = True
        await tracer.end()


async def _picture(tracer: Tracer) -> None:
    async with Flight(FlightPlan(mission="inspection", platform="pelican")) as flight:
        await flight.upload_and_start()
        tracer.is_begun = True
        await tracer.end()


async def _mission(tracer: Tracer) -> None:
    async with Flight(FlightPlan(mission="hop")) as flight:
        await flights.await_platform(flight.station, flight.name)
        await flights.await_ready(flight.station, flight.name)
        tracer.is_begun = True
        await flights.stream(flight.station, flight.name, read_plan("hop", flight.name))
        await flights.start(flight.station, flight.name)
        await tracer.end()


async def _record(tracer: Tracer) -> None:
    with TemporaryDirectory() as folder:
        async with Flight(FlightPlan(mission="hop", out=Path(folder))) as flight:
            await flights.await_platform(flight.station, flight.name)
            tracer.is_begun = True
            await tracer.end()


async def _status(tracer: Tracer) -> None:
    async with Flight(FlightPlan(mission="hop")) as flight:
        app = StationApp(Desk(flight.station))
        async with app.run_test(size=(120, 40)) as pilot:
            operator = Operator(app, pilot, flight.name)
            await operator.wait(lambda: app.platform is not None, "a vehicle")
            await operator.press("2")
            await operator.on(HealthScreen)
            tracer.is_begun = True
            await tracer.end()


async def _pause(tracer: Tracer) -> None:
    async with Flight(FlightPlan(mission="hop")) as flight:
        app = StationApp(Desk(flight.station))
        async with app.run_test(size=(120, 40)) as pilot:
            operator = Operator(app, pilot, flight.name)
            await operator.wait(lambda: app.platform is not None, "a vehicle")
            await operator.press("3")
            await operator.on(MissionScreen)
            await flight.upload_and_start()
            await operator.see("graph", "►")
            tracer.is_begun = True
            await operator.press("p")
            await tracer.end()


FLIGHTS: Final[dict[str, Callable[[Tracer], Coroutine[Any, Any, None]]]] = {
    "status": _status,
    "setpoint": _setpoint,
    "picture": _picture,
    "pause": _pause,
    "mission": _mission,
    "record": _record,
}
WITH_SCREEN: Final = ("status", "pause")
"""They need a loop that really waits."""


def stacks_of(name: str) -> list[list[Function]]:
    """Flies a walk: the stack of calls at each of its milestones."""
    with Tracer(WALKS[name]) as tracer:
        if name in WITH_SCREEN:
            with asyncio.Runner(loop_factory=PatientLoop) as runner:
                runner.run(FLIGHTS[name](tracer))
        else:
            run_virtual(FLIGHTS[name](tracer))
    return tracer.stacks


def functions_on(stacks: list[list[Function]]) -> list[Function]:
    """The union of stacks, in order."""
    return list(dict.fromkeys(function for stack in stacks for function in stack))


def files_on(functions: list[Function]) -> list[str]:
    """The modules of functions, in order."""
    return list(dict.fromkeys(function.module for function in functions))


# --- the page ---


def page() -> str:
    """The page, made by flying all walks."""
    lines = dict(_first_lines())
    return "\n".join([HEAD, *(_section(name, lines) for name in WALKS)])


def _section(name: str, lines: dict[str, str]) -> str:
    walk, seen = WALKS[name], set[Function]()
    stacks = stacks_of(name)
    functions = functions_on(stacks)
    rows = [f"## {walk.title}\n", f"{walk.about} {len(files_on(functions))} files, {len(functions)} functions.\n"]
    for number, (milestone, stack) in enumerate(zip(walk.milestones, stacks, strict=True), 1):
        rows.append(f"{number}. `{milestone.function.rpartition('.')[2]}`")
        for function in stack:
            if function not in seen:
                seen.add(function)
                first = lines.get(str(function), "")
                rows.append(f"    - `{function.module}` `{function.name}`{': ' if first else ''}{first}")
    return "\n".join([*rows, ""])


def _first_lines() -> Iterator[tuple[str, str]]:
    """The first lines of the docstrings of all functions."""
    for module in read_modules(ROOT).values():
        for where, function in functions_of(module.tree, module.name):
            yield where, (ast.get_docstring(function) or "").partition("\n")[0]


def listed(text: str) -> dict[str, list[Function]]:
    """The functions that a page lists, by the walks' titles."""
    found: dict[str, list[Function]] = {}
    for line in text.splitlines():
        if line.startswith("## "):
            found[line.removeprefix("## ")] = []
        elif line.startswith("    - `"):
            found[next(reversed(found))].append(Function(*line.split("`")[1:4:2]))
    return found
