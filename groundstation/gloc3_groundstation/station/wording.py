"""A platform's state in words, shared by the narration and the terminal's panels."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from gloc3.cli.counting import listed
from gloc3.exchange.acoustic import action_of
from gloc3.mavlink.flight_modes import mode_words
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import ContactSummary, Health, MissionSummary, VehicleLine, VehicleSummary
from gloc3.messages.vehicle import LandedState
from gloc3.mission.checking.estimate import span
from gloc3.mission.model.model import Policies, answer
from gloc3.mission.model.policy import Policy, resolved
from gloc3.network.rights import MemberRights
from gloc3_groundstation.missions.outline import Outline
from gloc3_groundstation.station.snapshots import ComponentSnapshot, Fleet, PlatformSnapshot

REPORTED_LOSS: Final = 0.05


class ItemLabel(NamedTuple):
    """A task or an action of a mission, as an operator sees it."""

    target: str
    """`TASK` or `TASK.ACTION`."""
    state: str
    progress: float | None
    """0 to 1; None, or 0, where it is unknown: some actions do not measure it."""
    times: str = ""
    """Of a task that is done several times: for which time, such as `2/5`."""

    @property
    def is_task(self) -> bool:
        """Whether it is a task, not an action."""
        return "." not in self.target

    @property
    def name(self) -> str:
        """Its own name, without its task's."""
        return self.target.rpartition(".")[2]


def items(mission: MissionSummary) -> list[ItemLabel]:
    """The tasks in the order of the mission, each followed by its actions."""
    found: list[ItemLabel] = []
    for task in [target for target in mission.tasks if "." not in target]:
        for target, state in mission.tasks.items():
            if target == task or target.startswith(f"{task}."):
                found.append(ItemLabel(target, state, mission.progress.get(target), times(mission, target)))
    return found


def times(mission: MissionSummary, task: str) -> str:
    """For which time a task is being done: `2/5`; empty for one that is done once."""
    count, most = mission.repetitions.get(task, (0, 0))
    return f"{count}/{most}" if count else ""


def used(mission: MissionSummary, outline: Outline) -> str:
    """Actual and estimated cost of a mission that has ended: `took 66 s (about 20 to 58), 61 m (about 56)`."""
    least = outline.least
    parts = [f"{mission.took_s:.0f} s" + _about(outline.duration_s, least.duration_s if least else None)]
    if mission.took_m >= 0.0:
        parts.append(f"{mission.took_m:.0f} m" + _about(outline.length_m, least.length_m if least else None))
    if mission.took_battery >= 0.0:
        share, least_share = outline.battery_share, least.battery_share if least else None
        text = _about(share and 100.0 * share, least_share and 100.0 * least_share)
        parts.append(f"{100.0 * mission.took_battery:.0f} % of the battery{text}")
    return "took " + ", ".join(parts)


def _about(most: float | None, least: float | None) -> str:
    return f" (about {span(least if least is not None else most, most)})" if most else ""


def running(mission: MissionSummary) -> str:
    """Running actions: `sweep.wall 42 %, sweep.photos`; paused ones are marked."""
    parts = []
    for item in items(mission):
        if item.is_task or item.state not in ("running", "paused"):
            continue
        percent = f" {item.progress * 100:.0f} %" if item.progress else ""
        if time := times(mission, item.target.partition(".")[0]):
            percent += f" ({time})"
        parts.append(item.target + percent + (" paused" if item.state == "paused" else ""))
    return ", ".join(parts)


def position(vehicle: VehicleSummary) -> str:
    """`x 4.2  y 1.0  h 2.0 m`, or that it is not known."""
    if not vehicle.is_pose_valid:
        return "position unknown"
    x_m, y_m, height_m = vehicle.position_m
    if not vehicle.frame and vehicle.geo is not None:
        return f"{vehicle.geo[0]:.5f} {vehicle.geo[1]:.5f} {round(height_m)} m"
    return f"x {tenths(x_m)}  y {tenths(y_m)}  h {tenths(height_m)} m"


def tenths(value: float) -> str:
    """`4.2`, and never `-0.0`."""
    return f"{round(value, 1) + 0.0:.1f}"


def bearing(degrees: float) -> str:
    """A heading or bearing, clockwise from north: `007°`; `–` for a negative one, which is not known."""
    return "–" if degrees < 0.0 else f"{round(degrees) % 360:03d}°"


def mode(platform: PlatformSnapshot) -> str:
    """The autopilot's mode by the name of its documents: `Hold`, `GUIDED`; empty while it is not known."""
    if platform.vehicle is None:
        return ""
    return mode_words(
        platform.vehicle.value.mode, platform.autopilot.firmware if platform.autopilot is not None else ""
    )


def summed_up_mode(vehicle: VehicleLine) -> str:
    """The mode of a vehicle in the summary of its region."""
    return mode_words(vehicle.mode)


def mode_detail(platform: PlatformSnapshot) -> str:
    """The same with the raw name behind it, where it differs: `Hold (AUTO.LOITER)`."""
    words, raw = mode(platform), "" if platform.vehicle is None else platform.vehicle.value.mode
    return words if words == raw else f"{words} ({raw.partition(',')[0]})"


def battery(vehicle: VehicleSummary) -> str:
    """`battery 92 %`, or that it is not known."""
    return f"battery {vehicle.battery_percent} %" if vehicle.battery_percent >= 0 else "battery unknown"


def armed(vehicle: VehicleSummary) -> str:
    """`armed`, `disarmed`; `armed?` while its companion receives no autopilot: it may be in the air."""
    if vehicle.is_armed:
        return "armed"
    is_unknown = not vehicle.is_autopilot_connected and vehicle.landed == LandedState.UNKNOWN
    return "armed?" if is_unknown else "disarmed"


def controller(vehicle: VehicleSummary) -> str:
    """Who has control in place of the mission: `the pilot`, `an operator`, or `the autopilot's failsafe`."""
    if vehicle.is_failsafe:
        return "the autopilot's failsafe"
    return "an operator, at the autopilot itself," if vehicle.is_operators else "the pilot"


def arming(vehicle: VehicleSummary) -> str:
    """`armed, in air`."""
    landed = vehicle.landed.replace("_", " ")
    return armed(vehicle) + (f", {landed}" if landed else "")


def duration(seconds: float) -> str:
    """`8 s`, `3 min 05 s`, `2 h 10 min`."""
    whole = int(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def roughly(seconds: float) -> str:
    """`8 s`, `3 min`, `2 h`: for a column."""
    whole = int(seconds)
    return f"{whole} s" if whole < 60 else f"{whole // 60} min" if whole < 3600 else f"{whole // 3600} h"


def clock(seconds: float) -> str:
    """`03:05`, or `2:10:00` from an hour on: time since the station's start."""
    whole = max(0, int(seconds))
    minutes = f"{whole % 3600 // 60:02d}:{whole % 60:02d}"
    return f"{whole // 3600}:{minutes}" if whole >= 3600 else minutes


def silence(platform: PlatformSnapshot, now_s: float) -> str:
    """`nothing heard for 7 s`, `silent as planned (dive), due 14:03:20 UTC`, or overdue; else empty."""
    if not platform.is_quiet_link(now_s):
        return ""
    planned, sound = platform.silence, by_sound(platform, now_s)
    if planned is not None and now_s < planned.due_s:
        return f"silent as planned ({planned.target}), due {planned.due_text}{sound}"
    if planned is not None:
        return f"OVERDUE by {duration(now_s - planned.due_s)} ({planned.target}), was due {planned.due_text}{sound}"
    return f"nothing heard for {duration(platform.age_s(now_s))}{sound}"


def by_sound(platform: PlatformSnapshot, now_s: float) -> str:
    """`; by sound 40 s ago: x 12.0  y 3.5  h -8.2 m, dive.out, battery 84 %` where it came after all else; else empty."""
    parts = received_by_sound(platform)
    if platform.acoustic is None or not parts:
        return ""
    return f"; acoustic {duration(platform.acoustic.age_s(now_s))} ago: {', '.join(parts)}"


def received_by_sound(platform: PlatformSnapshot) -> list[str]:
    """Position, action and other contents of the last acoustic summary, if it is the latest data; else empty."""
    timed = platform.acoustic
    if timed is None or timed.received_s < platform.received_s:
        return []
    reported = timed.value
    x_m, y_m, height_m = reported.position_m
    doing = action_of(reported, platform.mission.value if platform.mission is not None else None)
    return [
        f"x {tenths(x_m)}  y {tenths(y_m)}  h {tenths(height_m)} m" if reported.is_pose_valid else "position unknown",
        *filter(
            None, (f"policy {reported.policy}" if reported.policy else "", doing or reported.state or "no mission")
        ),
        *([f"battery {reported.battery_percent} %"] if reported.battery_percent >= 0 else []),
        *([f"components {reported.health}"] if reported.health is not Health.WORKING else []),
        *(["trouble below"] if reported.worst <= Severity.WARNING else []),
    ]


def contact(reported: ContactSummary, missed: int) -> str:
    """The state in a nutshell at the begin of a contact."""
    x_m, y_m, height_m = reported.position_m
    mission = f"mission {reported.mission!r} {reported.state}" if reported.mission else "no mission"
    parts = [
        f"contact after {duration(reported.silent_s)}" if reported.silent_s >= 0.0 else "contact",
        mission
        + (f", policy {reported.policy}" if reported.policy else "")
        + (f" ({reported.doing})" if reported.doing else ""),
        f"x {tenths(x_m)}  y {tenths(y_m)}  h {tenths(height_m)} m",
        *([f"battery {reported.battery_percent} %"] if reported.battery_percent >= 0 else []),
        f"components {reported.health}",
        *reported.conditions,
    ]
    if missed > 0:
        parts.append(
            f"{missed} events meanwhile"
            + (f", worst: {reported.worst_text}" if reported.worst_text and reported.worst <= Severity.NOTICE else "")
        )
    return "; ".join(parts)


def arrival(platform: PlatformSnapshot) -> str:
    """`status 80 %` where part of the periodic status is lost, or skipped by a slow link; else empty."""
    loss = platform.link.loss
    return f"status {(1.0 - loss) * 100.0:.0f} %" if loss >= REPORTED_LOSS else ""


def components(platform: PlatformSnapshot, now_s: float) -> str:
    """`3 components faulty: laser, pose, height; 1 absent: recorder`, or that all work."""
    if not platform.has_companion:
        return "no GLOC3 companion"
    known = platform.components(now_s)
    if not known:
        return "components unknown"
    parts: list[str] = []
    for health in reversed(Health):
        names = [one.name for one in known if one.health is health and not one.is_well]
        if names:
            what = "" if parts else " components" if len(names) > 1 else " component"
            parts.append(f"{len(names)}{what} {health}: {', '.join(names)}")
    return "; ".join(parts) or f"all {len(known)} components work"


def holder(platform: PlatformSnapshot, station: str) -> str:
    """Who holds control, from this station's point of view."""
    if not platform.has_companion:
        return "autopilot only: ctrl+p"
    if platform.control is None:
        return "control unknown"
    held_by = platform.control.value.holder
    if not held_by:
        return "nobody in control"
    return "this station in control" if held_by == station else f"station {held_by} in control"


def bare(platform: PlatformSnapshot) -> str:
    """Why a vehicle without a GLOC3 companion has no internal state, and what is available."""
    return f"{platform.name} has no GLOC3 companion, so its components are unknown; Services (6) shows its autopilot"


def farewell(fleet: Fleet) -> str:
    """What becomes of the vehicles when the station goes."""
    armed = [platform.name for platform in fleet if platform.is_armed]
    if not armed:
        return "stopped"
    fly = "flies" if len(armed) == 1 else "fly"
    return f"stopped; {', '.join(armed)} {fly} on by the mission's policies (on_link_loss)"


def after_abort(policies: Policies | None) -> str:
    """What follows when a mission is aborted: `it then holds in place, and lands after 60 s without an operator`.

    Args:
        policies: the mission's; None while they are not known.
    """
    return "its on_failure policy then runs" if policies is None else _then(Policy.ABORT, policies)


def without_component(
    component: ComponentSnapshot, others: Sequence[ComponentSnapshot], *, is_pose: bool, policies: Policies | None
) -> str:
    """What follows when a required component no longer works in flight.

    Args:
        component: the component.
        others: all components of its platform.
        is_pose: whether the pose comes from it.
        policies: of the loaded mission; None while they are not known.
    """
    standby = next((one.name for one in others if one.standby_for == component.name and one.is_well), None)
    if standby is not None:
        return f"{standby} takes over"
    if is_pose:
        follows = _then(answer(policies.on_pose_lost), policies) if policies else "the on_pose_lost policy then runs"
        return f"the pose is lost: {follows}"
    return f"nothing replaces it: actions that need it fail, and {after_abort(policies)}"


def _then(policy: Policy, policies: Policies) -> str:
    """What the vehicle does by a policy."""
    match resolved(policy, policies.on_failure):
        case Policy.HOLD:
            return f"it then holds in place, and lands after {policies.hold_s:g} s without an operator"
        case Policy.RETURN:
            return "it then returns and lands"
        case Policy.LAND:
            return "it then lands here"
        case _:
            return "it then goes on"


def roles(rights: MemberRights) -> str:
    """`operator (only land) until 2026-12-01 00:00 UTC`; without a rights file `operator with all rights`."""
    return listed([str(held) for held in rights.roles], "and") if rights.roles else "free to do what its link permits"
