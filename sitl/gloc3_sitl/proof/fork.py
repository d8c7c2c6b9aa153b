"""Flies on from a moment of a recorded flight with something changed: the same flight until then, bit for bit."""

import asyncio
from collections.abc import Sequence
from math import dist
from pathlib import Path
from typing import Any, Final

import msgspec

from gloc3.errors import Gloc3Error, Refused
from gloc3.log.reader import LogReader, find_log
from gloc3.log.record import PLATFORM_FILE
from gloc3.messages.command_interface import CiRequest, Emergency, Steer, Verb
from gloc3.messages.frames import GeoPoint, Vector3
from gloc3.messages.topics import TopicTable
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.messages import SimFault, SimTruth
from gloc3_sitl.flight.plan import MISSION_FILE, WORLD_FILE
from gloc3_sitl.physics.wind import CALM, Wind
from gloc3_sitl.proof.case import FlightCase
from gloc3_sitl.proof.invariant import BrokenInvariant
from gloc3_sitl.proof.standard_invariants import invariants_but
from gloc3_sitl.proof.trial import Conditions, TrialResult, fly_case

SAME_M: Final = 1e-6


class Changed(msgspec.Struct, frozen=True, kw_only=True):
    """What is otherwise from a moment on."""

    at_s: float
    components: dict[str, str] = {}
    """Component to `package.module:Class`."""
    settings: dict[str, dict[str, Any]] = {}
    """Component to settings."""
    faults: tuple[str, ...] = ()
    """Without times: they begin at the moment."""


class Forked(msgspec.Struct, frozen=True, kw_only=True):
    """The recorded flight and the one that was flown on otherwise."""

    recorded_s: float
    """When the recorded flight ended."""
    flown_s: float
    state: str
    """Of the mission, at the end of the new one."""
    reason: str
    apart_s: float | None
    """When the two are apart by more than a micrometre; None where they never are."""
    most_apart_m: float
    """At the same time."""
    broken: tuple[BrokenInvariant, ...] = ()
    story: tuple[str, ...] = ()
    """What happens in the new one from the moment on."""


def fork(log: Path, changed: Changed, out: Path) -> Forked:
    """Flies a log's flight again, and on from a moment with something changed.

    Args:
        log: of a flight in virtual time, or the folder of its run.
        changed: from when, and what.
        out: a folder for the new log and a picture of both.

    Raises:
        Gloc3Error: the log does not hold what the flight needs, or the flight is another one before the moment.
    """
    if not changed.at_s >= 0.0 or any("@" in fault for fault in changed.faults):
        raise Refused("the change comes at one time of the flight: --at in seconds from 0, and faults without times")
    with LogReader(find_log(log), TopicTable.installed().types) as reader:
        reader.require_ours("simulated flight")
        recorded = _positions(reader)
        case, conditions = _case(reader, out)
    if recorded and changed.at_s >= recorded[-1][0]:
        raise Refused(f"{log} ended at {recorded[-1][0]:.1f} s: nothing can be changed at {changed.at_s:g} s")
    faults = tuple(
        f"{fault}@{changed.at_s:g}.." if _lasts(fault) else f"{fault}@{changed.at_s:g}" for fault in changed.faults
    )
    case = msgspec.structs.replace(case, faults=(*case.faults, *faults))
    positions: list[tuple[float, Vector3]] = []
    result = _fly(case, conditions, changed, out, positions)
    if result.refused:
        raise Refused(f"{log} cannot be flown again: {result.refused}")
    found = _compare(recorded, positions, changed.at_s)
    _draw(recorded, positions, out)
    return Forked(
        recorded_s=recorded[-1][0] if recorded else 0.0,
        flown_s=result.ended_s,
        state=result.state,
        reason=result.reason,
        apart_s=found[0],
        most_apart_m=found[1],
        broken=result.broken,
        story=tuple(line for line in result.story if float(line.split(" s ", 1)[0]) >= changed.at_s),
    )


def _lasts(fault: str) -> bool:
    """Whether a fault without times lasts."""
    from gloc3_sitl.faults.faults import read_fault

    return read_fault(fault).lasts_s is not None


# --- what the log says ---


def _case(reader: LogReader, out: Path) -> tuple[FlightCase, Conditions]:
    """The flight that was recorded."""
    attached = reader.attachments
    if reader.run.get("time") != "virtual" or "seed" not in reader.run:
        raise Refused(f"{reader.path} is not of a flight in virtual time: only such a flight can be flown again")
    if PLATFORM_FILE not in attached or MISSION_FILE not in attached:
        raise Refused(f"{reader.path} holds no platform file and mission")
    platform = out / "forked-platform.yaml"
    platform.write_bytes(attached[PLATFORM_FILE])
    run = reader.run
    world = run.get("world", "")
    if WORLD_FILE in attached:
        world = str(out / "forked-world.yaml")
        Path(world).write_bytes(attached[WORLD_FILE])
    case = FlightCase(
        mission="",
        text=attached[MISSION_FILE].decode(),
        platform=str(platform),
        autopilot=run.get("autopilot", ""),
        seed=int(run["seed"]),
        waves_m=float(run.get("waves_m", 0.0)),
        current_m_s=float(run.get("current_m_s", 0.0)),
        world=world,
        home=msgspec.json.decode(run["home"], type=GeoPoint) if "home" in run else None,
        faults=(*_faults(reader), *_commands(reader)),
    )
    return case, Conditions(
        wind=msgspec.json.decode(run["wind"], type=Wind) if "wind" in run else CALM,
        terrain=Path(run["terrain"]) if "terrain" in run else None,
        parameters=msgspec.json.decode(run.get("parameters", "{}"), type=dict[str, float]),
    )


def _faults(reader: LogReader) -> list[str]:
    """The faults as they were asked for."""
    found: list[str] = []
    for entry in reader.entries("sim/fault"):
        fault = entry.envelope.payload
        if isinstance(fault, SimFault) and fault.is_present:
            found.append(fault.fault if "@" in fault.fault else f"{fault.fault}@{entry.now_s:g}..")
    return [text for text in dict.fromkeys(found) if text]


def _commands(reader: LogReader) -> list[str]:
    """What operators asked for beside what starts every flight, and beside what a fault has them say."""
    injected = {text.partition("@")[0] for text in _faults(reader)}
    found: list[str] = []
    for entry in reader.entries("ci/request"):
        request = entry.envelope.payload
        if not isinstance(request, CiRequest):
            continue
        body = request.body
        if isinstance(body, Steer) and body.verb is not Verb.START:
            what = f"operator:{body.verb}" + (f"={body.target}" if body.target else "")
        elif isinstance(body, Emergency) and body.verb != "disarm":
            what = f"operator:{body.verb}"
        else:
            continue
        if what not in injected:
            found.append(f"{what}@{entry.now_s:.3f}")
    return found


def _positions(reader: LogReader) -> list[tuple[float, Vector3]]:
    return [
        (entry.envelope.t_s, entry.envelope.payload.position_ned_m)
        for entry in reader.entries("sim/truth")
        if isinstance(entry.envelope.payload, SimTruth)
    ]


# --- the new flight ---


def _fly(
    case: FlightCase, conditions: Conditions, changed: Changed, out: Path, positions: list[tuple[float, Vector3]]
) -> TrialResult:
    problems: list[str] = []
    tasks: list[asyncio.Task[None]] = []

    def prepare(flight: Flight) -> None:
        flight.exchange.subscribe(
            f"{flight.name}/sim/truth", lambda one: positions.append((one.t_s, one.payload.position_ned_m))
        )
        tasks.extend(
            flight.loop.create_task(_change(flight, name, changed), name=name)
            for name in {**changed.components, **changed.settings}
        )
        for task in tasks:
            task.add_done_callback(lambda done: problems.extend(_problem(done)))

    # What is exchanged ends its action, as a component that is shut down does: that is no fault of the others.
    kinds = invariants_but(("goes_on",)) if changed.components or changed.settings else None
    result = fly_case(case, out=out, kinds=kinds, is_stopping=False, prepare=prepare, conditions=conditions)
    late = [f"the flight ended before {task.get_name()} was exchanged" for task in tasks if task.cancelled()]
    if problems or late:
        raise Refused((problems or late)[0])
    return result


async def _change(flight: Flight, name: str, changed: Changed) -> None:
    await asyncio.sleep(changed.at_s - flight.loop.time())
    await flight.exchange_component(name, changed.components.get(name, ""), changed.settings.get(name, {}))


def _problem(task: "asyncio.Task[None]") -> list[str]:
    error = None if task.cancelled() else task.exception()
    return [] if error is None else [str(error)]


def _compare(
    recorded: Sequence[tuple[float, Vector3]], flown: Sequence[tuple[float, Vector3]], at_s: float
) -> tuple[float | None, float]:
    """When the two begin to differ, and by how much at most.

    Raises:
        Gloc3Error: they differ before the moment.
    """
    apart_s, most_m = None, 0.0
    known = dict(flown)
    for t_s, position in recorded:
        other = known.get(t_s)
        apart_m = dist(position, other) if other is not None else 0.0
        most_m = max(most_m, apart_m)
        if apart_m > SAME_M and apart_s is None:
            apart_s = t_s
    if apart_s is not None and apart_s < at_s:
        raise Gloc3Error(
            f"the flight is not the recorded one: they differ from {apart_s:.1f} s on. Was it flown with another version?"
        )
    return apart_s, round(most_m, 3)


def _draw(recorded: Sequence[tuple[float, Vector3]], flown: Sequence[tuple[float, Vector3]], out: Path) -> None:
    from gloc3.log.report.plot import plot_path

    plot_path(
        [position for _, position in flown],
        [position for _, position in recorded],
        out / "fork.svg",
        waypoints=(),
        title="recorded (dotted), and flown on otherwise (solid)",
    )
