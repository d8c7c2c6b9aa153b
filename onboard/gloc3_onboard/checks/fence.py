"""Checks that the autopilot's fence keeps the mission's, and does not stop the mission."""

from collections.abc import Iterator
from math import ceil, floor, hypot
from typing import Final

from gloc3.amounts import beside
from gloc3.messages.frames import Vector3
from gloc3.messages.preflight import Check, Group, Verdict
from gloc3.messages.readiness import AutopilotSetup
from gloc3.mission.formats.from_mission import fence_on_earth
from gloc3.mission.model.arguments import FollowWaypointsOrder, Teleoperate
from gloc3.mission.model.legs import Budget
from gloc3.mission.model.model import Mission, part_of
from gloc3.mission.model.policy import Policy
from gloc3.platform.limits import Limits
from gloc3_onboard.autopilot.health_words import FENCE_BIT
from gloc3_onboard.checks.failsafes import action_of
from gloc3_onboard.checks.parameters import CONTINUE, POLYGONS, Failsafe, FenceLimit, FenceTable
from gloc3_onboard.checks.readings import Readings
from gloc3_onboard.checks.tables import table_of

GROUP: Final = Group.FAILSAFES
TITLE: Final = "fence"
_REACHES: Final = {"away": "{:.1f} m away from home", "up": "{:.1f} m above home", "down": "{:.1f} m below home"}


def fence_checks(readings: Readings) -> Iterator[Check]:
    """The autopilot's action at the mission's fence, and its own limits that the mission would cross."""
    setup, mission = readings.setup, readings.mission
    if setup is None or setup.style is None or not setup.is_complete or mission is None:
        return
    table = table_of(setup.style, setup.vehicle)
    fence = table.fence
    has_fence = bool(fence_on_earth(mission, readings.platform.frames))
    is_stopped = has_fence and action_of(setup, fence.breach) not in (CONTINUE, None)
    yield from _flies_on(setup, table.setpoints_lost, mission, readings.platform.limits, is_stopped=is_stopped)
    if has_fence:
        yield _breach(setup, fence)
        yield from _polygons(setup, fence)
        yield from _ceiling(setup, fence, mission, readings.home_ned_m)
    if readings.home_ned_m is not None and (has_fence or _is_on(setup, fence)):
        yield from _limits(setup, fence, mission, readings.platform.limits, readings.home_ned_m)


def _flies_on(
    setup: AutopilotSetup, lost: Failsafe, mission: Mission, limits: Limits, *, is_stopped: bool
) -> Iterator[Check]:
    """Whether the vehicle stays inside while the autopilot waits for setpoints of a companion that has died."""
    timeout_s = lost.limit(setup.parameters.get)
    if mission.fence is None or timeout_s is None:
        return
    orders = [action.order for part in flights_of(mission) for action in part.actions().values()]
    paths = [order for order in orders if isinstance(order, FollowWaypointsOrder)]
    near = [(mission.fence.clearance_m(place), order.speed_m_s) for order in paths for place in order.waypoints_ned_m]
    near += [
        (limits.margin_m, order.speed_m_s or limits.speed_m_s) for order in orders if isinstance(order, Teleoperate)
    ]
    worst = min(
        near,
        key=lambda one: one[0] - _run_on_m(one[1], timeout_s, limits),
        default=None,
    )
    if worst is None or (needed_m := _run_on_m(worst[1], timeout_s, limits)) <= worst[0]:
        return
    finding = (
        f"at {worst[1]:g} m/s the autopilot flies on for {timeout_s:g} s and {needed_m:.1f} m if the companion dies; "
        f"the mission comes within {worst[0]:.1f} m of its fence"
    )
    if is_stopped:
        yield Check(GROUP, "companion lost", Verdict.OK, f"{finding}, at which the autopilot acts by itself")
        return
    names = " or ".join(lost.limit_parameters)
    advice = "fly slower there, or keep waypoints farther from the fence"
    yield Check(GROUP, "companion lost", Verdict.WARNING, finding, f"lower {names}, {advice}" if names else advice)


def _run_on_m(speed_m_s: float, timeout_s: float, limits: Limits) -> float:
    """How far it flies on, brakes, and is displaced by the stated wind."""
    wind_m = limits.margin_m - limits.fence_margin_m
    return speed_m_s * timeout_s + speed_m_s**2 / (2.0 * limits.acceleration_m_s2) + wind_m


def _is_on(setup: AutopilotSetup, fence: FenceTable) -> bool:
    """Whether the autopilot enforces its own limits, regardless of the mission."""
    if action_of(setup, fence.breach) == CONTINUE:
        return False
    is_switched_on = bool(setup.sensors_enabled & FENCE_BIT)
    return not fence.enabled_by or is_switched_on or setup.parameters.get(fence.enabled_by, 0.0) != 0.0


def _breach(setup: AutopilotSetup, fence: FenceTable) -> Check:
    """The autopilot does something at the fence, and nothing that no platform file allows."""
    name, action = fence.breach.parameter, action_of(setup, fence.breach)
    if not name:
        finding = "the autopilot only records that the vehicle leaves its fence: the limiter alone keeps the mission's"
        return Check(GROUP, TITLE, Verdict.WARNING, finding)
    if action is None:
        return Check(GROUP, TITLE, Verdict.UNKNOWN, f"{name} could not be read")
    finding = f"{action} ({name} {setup.parameters[name]:g})"
    right = {number: what for number, what in fence.breach.actions.items() if what in list(Policy) and what != CONTINUE}
    if action in right.values():
        return Check(GROUP, TITLE, Verdict.OK, finding)
    advice = f"set {name} to one of {', '.join(f'{number} ({what})' for number, what in right.items())}"
    if action == CONTINUE:
        finding += ": the autopilot would let the vehicle leave the mission's fence"
        return Check(GROUP, TITLE, Verdict.RED, finding, advice)
    return Check(GROUP, TITLE, Verdict.WARNING, finding, advice)


def _polygons(setup: AutopilotSetup, fence: FenceTable) -> Iterator[Check]:
    kinds = setup.parameters.get(fence.kinds)
    if kinds is not None and not int(kinds) & POLYGONS:
        finding = f"{kinds:g} leaves out polygons and circles, of which the mission's fence is made"
        yield Check(GROUP, fence.kinds, Verdict.RED, finding, f"set {fence.kinds} to {int(kinds) | POLYGONS}")


def _ceiling(setup: AutopilotSetup, fence: FenceTable, mission: Mission, home_ned_m: Vector3 | None) -> Iterator[Check]:
    """Whether the autopilot keeps the mission's ceiling: the areas that are uploaded to it have none."""
    limit = next((one for one in fence.limits if one.reach == "up"), None)
    if limit is None or home_ned_m is None or mission.fence is None or mission.fence.ceiling_m is None:
        return
    value = setup.parameters.get(limit.parameter)
    if value is None:
        return
    ceiling_m = mission.fence.ceiling_m + home_ned_m[2]
    kinds = int(setup.parameters.get(fence.kinds, 0.0))
    is_selected = bool(kinds & limit.kind) if limit.kind else value > 0.0
    if is_selected and value <= ceiling_m:
        finding = f"{beside(ceiling_m, value)} m above home; the autopilot keeps {value:g} m ({limit.parameter})"
        yield Check(GROUP, "ceiling", Verdict.OK, finding)
        return
    limiter = "GLOC3's limiter alone keeps it"
    theirs = (
        f"the autopilot's limit {value:g} m: between them {limiter}"
        if is_selected
        else f"the autopilot has no limit of height: {limiter}"
    )
    advice = f"set {limit.parameter} to {floor(ceiling_m)}"
    advice += f" and {fence.kinds} to {kinds | limit.kind}" if not is_selected and limit.kind else ""
    finding = f"the mission's ceiling is {beside(ceiling_m, value)} m above home, and {theirs}"
    yield Check(GROUP, "ceiling", Verdict.WARNING, finding, advice)


def _limits(
    setup: AutopilotSetup, fence: FenceTable, mission: Mission, limits: Limits, home_ned_m: Vector3
) -> Iterator[Check]:
    """Limits nearer than the mission's farthest place, with the margin that the platform keeps from a fence."""
    kinds = int(setup.parameters.get(fence.kinds, 0.0))
    held = {one: setup.parameters[one.parameter] for one in fence.limits if one.parameter in setup.parameters}
    acting = {one: value for one, value in held.items() if (kinds & one.kind if one.kind else value > 0.0)}
    if not acting:
        return
    reaches = reach_m(mission, limits, home_ned_m)
    for one, value in acting.items():
        limit_m = -value if one.reach == "down" else value
        needed_m = reaches[one.reach] + limits.margin_m
        if needed_m <= limit_m:
            continue
        reached = _REACHES[one.reach].format(reaches[one.reach])
        finding = (
            f"the mission goes {reached}, with a margin of {limits.margin_m:g} m; the autopilot's limit is {value:g} m"
        )
        yield Check(GROUP, one.parameter, Verdict.RED, finding, _advice(one, fence, needed_m, kinds))


def _advice(limit: FenceLimit, fence: FenceTable, needed_m: float, kinds: int) -> str:
    wanted = f"-{ceil(needed_m)} or less" if limit.reach == "down" else f"{ceil(needed_m)} or more"
    or_off = f"{fence.kinds} to {kinds & ~limit.kind}" if limit.kind else f"{limit.parameter} to 0"
    return f"set {limit.parameter} to {wanted}, or {or_off}, or change the mission"


def flights_of(mission: Mission) -> list[Mission]:
    """The mission, and each of its contingencies as a mission of its own."""
    contingencies = [name for name, task in mission.contingencies.items() if task.actions]
    return [mission, *(part_of(mission, name) for name in contingencies)]


def reach_m(mission: Mission, limits: Limits, home_ned_m: Vector3) -> dict[str, float]:
    """Reach of a mission and its contingencies from home, in metres: `away` over ground, `up`, and `down`.

    Vehicles that cannot turn on the spot reach farther by the radius of their turns.
    """
    budget = Budget.of(limits, home_ned_m)
    found = dict.fromkeys(_REACHES, 0.0)
    for part in flights_of(mission):
        for order in (action.order for action in part.actions().values()):
            if isinstance(order, FollowWaypointsOrder):  # there may be thousands, and this is done in the control path
                places = order.waypoints_ned_m
            else:
                places = tuple(leg.end for leg in order.legs(home_ned_m, budget))
            for north, east, down in places:
                away_m = hypot(north - home_ned_m[0], east - home_ned_m[1])
                found["away"] = max(found["away"], away_m + limits.turn_radius_m)
                found["up"] = max(found["up"], home_ned_m[2] - down)
                found["down"] = max(found["down"], down - home_ned_m[2])
    return found
