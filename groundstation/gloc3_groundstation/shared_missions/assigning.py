"""Assigns the open tasks of a mission to vehicles in contact: by their platform files, where they are, and their charge."""

from collections.abc import Mapping, Sequence

import msgspec

from gloc3.errors import InputError, Refused
from gloc3.messages.frames import GeoPoint, LocalFrame
from gloc3.mission.assigning.assignment import AvailableVehicle, TaskAssignment, assign
from gloc3.mission.checking.checker import Circumstances
from gloc3.mission.model.states import ActionState
from gloc3.platform.platform import Platform
from gloc3.platform.reader import load_platform
from gloc3_groundstation.missions.plans import CheckedPlan, known_platform
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.station.station import Station


def assigned(
    station: Station,
    plan: CheckedPlan,
    names: Sequence[str],
    files: Sequence[str] = (),
    ended: Mapping[str, tuple[str, ...]] | None = None,
    kept: Mapping[str, tuple[str, ...]] | None = None,
) -> tuple[CheckedPlan, TaskAssignment]:
    """Assigns the open tasks of a mission to vehicles in contact, and has each one's part checked.

    Args:
        station: knows the vehicles.
        plan: the mission.
        names: of the vehicles.
        files: platform files beside those that are installed.
        ended: tasks that others have done, by their platforms.
        kept: tasks that stay where they are, by platform.

    Returns:
        The mission with its assignment, and who does what.

    Raises:
        Refused: there is no vehicle, or the platform file of one is not known here.
        InputError: a task can be performed by none, or a part may not fly; with all findings.
    """
    if not names:
        raise Refused("no vehicle is in contact to assign the tasks to")
    vehicles = [vehicle_of(station, name, files, (kept or {}).get(name, ())) for name in names]
    found = assign(plan.text, plan.name, vehicles, Circumstances(terrain=station.terrain), ended)
    if not found.is_ok:
        raise InputError(found.report.findings)
    platforms = tuple(
        dict.fromkeys([*found.assigned, *(found.report.mission.platforms if found.report.mission else ())])
    )
    made = msgspec.structs.replace(plan, text=found.text, platforms=platforms, unassigned=())
    return made, found


def vehicle_of(station: Station, name: str, files: Sequence[str] = (), kept: tuple[str, ...] = ()) -> AvailableVehicle:
    """What is known of a vehicle in contact; `kept` are tasks that stay its own.

    Raises:
        Refused: it is not in contact, or its platform file is not known here.
    """
    known = station.fleet.get(name)
    if known is None:
        raise Refused(f"{name} is not in contact")
    platform = _platform(known, files)
    geo = known.vehicle.value.geo if known.vehicle is not None else None
    place = GeoPoint(*geo) if geo is not None else None
    percent = known.vehicle.value.battery_percent if known.vehicle is not None else -1
    begun, open_states = begun_tasks(known), (ActionState.RUNNING, ActionState.PAUSED)
    return AvailableVehicle(
        platform=platform,
        home=home_of(known) or place,
        place=place if known.is_flying else None,
        battery=percent / 100.0 if percent >= 0 else 1.0,
        begun=tuple(sorted(begun, key=lambda task: begun[task] in open_states)),  # each after those that have ended
        running=tuple(task for task, state in begun.items() if state in open_states),
        kept=tuple(task for task in kept if task not in begun),
    )


def begun_tasks(platform: PlatformSnapshot) -> dict[str, str]:
    """The own tasks of its running mission that a vehicle has begun or ended, with their states."""
    mission = platform.mission.value if platform.mission is not None else None
    if mission is None or mission.state not in (ActionState.RUNNING, ActionState.PAUSED):
        return {}
    own = {name: state for name, state in mission.tasks.items() if "." not in name and name not in mission.elsewhere}
    return {name: state for name, state in own.items() if state != ActionState.WAITING}


def home_of(platform: PlatformSnapshot) -> GeoPoint | None:
    """Where a vehicle was armed, or stands; None while that is not known."""
    site = platform.site.value if platform.site is not None else None
    if site is None or site.origin_geo is None or site.home_m is None:
        return None
    return LocalFrame(GeoPoint(*site.origin_geo), site.x_axis_bearing_deg).to_geo(site.home_m)


def _platform(known: PlatformSnapshot, files: Sequence[str]) -> Platform:
    for file in files:
        given = load_platform(file)
        if given.platform == known.name and known.platform_digest in ("", given.digest()):
            return given
    found = known_platform(known.name, known.component_names, known.platform_digest)
    if found is None:
        raise Refused(
            f"the platform file of {known.name} is not known here, or differs: give it with --platform, so that its part "
            "can be checked"
        )
    return found
