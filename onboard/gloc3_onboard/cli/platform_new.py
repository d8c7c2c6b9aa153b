"""A new platform file: from a connected autopilot, a person's answers, and the components of its class."""

import asyncio
from collections.abc import Iterator, Mapping
from math import inf
from typing import Final, NamedTuple

from gloc3.clock import Clock
from gloc3.documents.format_version import KEY, VERSION
from gloc3.errors import NoContact
from gloc3.messages.readiness import AutopilotSetup
from gloc3.messages.vehicle import Style, VehicleClass
from gloc3_onboard.autopilot.link import AutopilotLink
from gloc3_onboard.checks.failsafes import action_of
from gloc3_onboard.checks.parameters import CONTINUE, HOLD, LAND, RETURN, Failsafe
from gloc3_onboard.checks.tables import table_of
from gloc3_onboard.cli.direct import beat, heartbeat_of, open_direct, signing_of
from gloc3_onboard.cli.platform_readings import Reading, names_of, read_limits

POLL_PERIOD_S: Final = 0.1
ALLOWED: Final = (HOLD, RETURN, LAND)
CAMERA: Final = ("ground_camera", "ground_recorder")
"""The components that there are only with a camera."""
ASSUMED: Final = "assumed"
SHARE: Final = 0.6
"""Share of the greatest acceleration used on paths."""
AT_REST_1_S: Final = 0.4
"""Speed at which a vehicle counts as at rest, as a share of the accuracy of its position a second: the velocity of such
an estimate is as restless."""
TYPES: Final = {2: "quadrotor", 13: "hexarotor"}
"""Vehicle types by MAV_TYPE, where one has several."""
RECORD_IMAGES: Final = "record_images"
"""The capability that there is only with one."""


def _noted(text: str, note: str) -> str:
    """A line with a comment behind it."""
    return f"{text:<31} # {note}"


class VehicleKind(NamedTuple):
    """A class of vehicle: its components and assumed limits."""

    base: str
    """What it extends: capabilities and components."""
    types: tuple[str, ...]
    """What it may be called, the likeliest first."""
    mass_kg: float
    speed_m_s: float
    climb_m_s: float
    landing_m_s: float
    acceleration_m_s2: float
    heights_m: tuple[float, float]
    fence_margin_m: float
    power: str
    battery_wh: float
    sets_off: str = "setting_off"
    """The component that arms it."""
    braking_share: float | None = None
    """Of the greatest acceleration, with which it brakes; None where its autopilot flies the paths."""
    acceptance_m: float = 0.0
    """With plain satellites, waypoints are passed no more exactly; 0 where its controller says so itself."""
    tolerance_m: float = 0.0
    """The same of the height at which a take-off is done."""
    at_rest_over_s: float = 0.0
    """So long the driver averages its velocity to see whether it stands."""
    more: Mapping[str, tuple[float, str]] = {}
    """Further limits, with their meaning."""


KINDS: Final = {
    VehicleClass.COPTER: VehicleKind(
        "multirotor", ("quadrotor", "hexarotor"), 1.5, 3.0, 1.0, 0.5, 2.0, (0.3, 30.0), 1.0,
        "hover_w: 250, per_m_s_w: 4, climb_w_per_m_s: 16, avionics_w: 12", 74.0, braking_share=0.7, acceptance_m=1.0,
        tolerance_m=0.5,
    ),
    VehicleClass.ROVER: VehicleKind(
        "wheeled", ("rover",), 5.0, 2.0, 1.0, 0.5, 1.0, (-0.5, 0.5), 2.0,
        "hover_w: 5, per_m_s_w: 20, avionics_w: 12", 74.0, braking_share=0.6,
    ),
    VehicleClass.BOAT: VehicleKind(
        "wheeled", ("boat",), 10.0, 2.0, 1.0, 0.5, 0.5, (-0.5, 0.5), 3.0,
        "hover_w: 20, per_m_s_w: 60, avionics_w: 12", 150.0, braking_share=0.6, at_rest_over_s=6.0,
    ),
    VehicleClass.SUB: VehicleKind(
        "underwater", ("auv", "rov"), 11.0, 1.0, 0.5, 0.3, 0.5, (-40.0, 0.5), 1.0,
        "hover_w: 40, per_m_s_w: 60, avionics_w: 20", 260.0, braking_share=0.6,
    ),
    VehicleClass.PLANE: VehicleKind(
        "fixed_wing", ("aircraft",), 3.0, 25.0, 3.0, 0.8, 2.0, (20.0, 100.0), 30.0,
        "hover_w: 200, per_m_s_w: 4, climb_w_per_m_s: 60, avionics_w: 12", 150.0, "ways",
        more={
            "survey_height_m": (50.0, "of take-offs and patterns without one"),
            "survey_speed_m_s": (18.0, "of paths without one"),
            "survey_acceptance_m": (30.0, "acceptance radius of waypoints"),
            "speed_min_m_s": (13.0, "slower paths are refused"),
            "turn_radius_m": (80.0, "compare it with WP_LOITER_RAD"),
            "approach_m": (400.0, "where landings begin before home; 0 where they do not follow the runway"),
            "landing_roll_m": (200.0, "beyond home, until it stands"),
        },
    ),
    VehicleClass.VTOL: VehicleKind(
        "fixed_wing_vtol", ("vtol",), 5.0, 25.0, 2.5, 0.7, 2.0, (2.0, 100.0), 30.0,
        "hover_w: 1000, per_m_s_w: 10, climb_w_per_m_s: 90, avionics_w: 12, wings_w: 250", 350.0, "ways",
        more={
            "survey_height_m": (50.0, "of take-offs and patterns without one"),
            "survey_speed_m_s": (18.0, "of paths on wings without one"),
            "survey_acceptance_m": (30.0, "acceptance radius of waypoints on wings"),
            "speed_min_m_s": (13.0, "slower paths on wings are refused"),
            "turn_radius_m": (80.0, "compare it with WP_LOITER_RAD or NAV_LOITER_RAD"),
            "rotors_speed_m_s": (5.0, "of paths on rotors"),
            "transition_m": (150.0, "from wings to a hover, and from a hover to wings"),
            "wings_height_min_m": (20.0, "least height of paths on wings"),
        },
    ),
}  # fmt: skip
"""By class."""


class Found(NamedTuple):
    """Properties that the autopilot has reported."""

    setup: AutopilotSetup
    origin_geo: tuple[float, float, float] | None
    """Its position; None if unknown."""
    battery_v: float = 0.0
    """0 where it is not measured."""
    mav_type: int = 0
    """MAV_TYPE of its heartbeat; 0 is a generic one."""

    @property
    def title(self) -> str:
        """What it is, in words."""
        setup = self.setup
        version = ".".join(map(str, setup.firmware)) if setup.firmware else "of an unknown version"
        style = "PX4" if setup.style is Style.PX4 else "ArduPilot"
        return f"{style} {version}, {setup.vehicle or 'vehicle of an unknown class'}"

    @property
    def type(self) -> str:
        """The vehicle type; empty where the heartbeat has no known one."""
        return TYPES.get(self.mav_type, "")

    @property
    def readings(self) -> dict[str, Reading]:
        """What its parameters say of limits and battery, by name in the platform file."""
        found = read_limits(self.setup, self.battery_v)
        survey = found.get("survey_speed_m_s")
        if survey is not None and self.setup.vehicle in KINDS and survey.value > KINDS[self.setup.vehicle].speed_m_s:
            found["speed_m_s"] = survey
        return found


class Answers(NamedTuple):
    """Properties given by a person."""

    name: str
    type: str
    mass_kg: float
    speed_m_s: float
    height_max_m: float
    battery_wh: float
    arm: bool
    on_stop: str
    camera: str
    """A source's URL; empty for none."""


async def probe_autopilot(autopilot: str, wait_s: float, system_id: int) -> Found:
    """Listens to the autopilot until everything is known, or the time is up.

    Raises:
        Refused: the link cannot be opened.
        NoContact: no autopilot responds.
    """
    loop = asyncio.get_running_loop()
    clock = Clock(loop)
    link = AutopilotLink(loop, clock, system_id, signing=signing_of(autopilot, clock), more_names=names_of)
    endpoint = await open_direct(link, autopilot, loop)
    try:
        end_s, heart = loop.time() + wait_s, heartbeat_of(link.own)
        while loop.time() < end_s:
            beat(heart, link, loop.time())
            await asyncio.sleep(POLL_PERIOD_S)
            setup, stamped = link.inspection.setup, link.telemetry.pose
            has_status = setup.firmware and setup.sensors_present  # the battery's voltage comes with the latter
            if setup.is_complete and has_status and stamped is not None and stamped.pose.origin_geo is not None:
                break
        setup, stamped = link.inspection.setup, link.telemetry.pose
        battery_v, heartbeat = link.telemetry.state.battery_v, link.heartbeat
    finally:
        link.close()
        await endpoint.close()
    if setup.style is None or setup.vehicle is None:
        raise NoContact(
            f"no autopilot responds at {autopilot} within {wait_s:g} s{f'; {endpoint.problem}' if endpoint.problem else ''}"
        )
    origin_geo = stamped.pose.origin_geo if stamped is not None else None
    return Found(setup, origin_geo, battery_v, heartbeat.type if heartbeat is not None else 0)


def platform_text(found: Found, answers: Answers) -> str:
    """The platform file."""
    setup = found.setup
    assert setup.vehicle is not None
    kind, readings = KINDS[setup.vehicle], found.readings
    source = _answered("battery_wh", answers.battery_wh, readings).source
    battery = f"   # battery_wh: {source}" if source else ""
    vehicle = f"vehicle: {{type: {answers.type}, mass_kg: {answers.mass_kg:g}}}"
    acceleration = readings.get("acceleration_m_s2", Reading(kind.acceleration_m_s2, ASSUMED))
    lines = [
        f"# {answers.name}: made from its autopilot, {found.title}. Check it with: gloc3 platform check",
        f"{KEY}: {VERSION}",
        f"platform: {answers.name}",
        _noted(f"extends: {kind.base}", "its capabilities and components; gloc3 platform show --full prints them"),
        _noted(vehicle, f"type: MAV_TYPE {found.mav_type}") if answers.type == found.type else vehicle,
        _noted(f"arm: {str(answers.arm).lower()}", "whether a mission may arm the vehicle"),
        _noted(f"on_stop: {answers.on_stop}", "in flight, when the onboard process is stopped: hold or land"),
        *_frame(found.origin_geo),
        _noted("limits:", "missions are checked against them, and the vehicle is held to them"),
        *_limits(kind, answers, readings, acceleration),
        "# The energy of a mission is estimated with this: correct it after some flights.",
        f"power: {{{kind.power}, battery_wh: {answers.battery_wh:g}, reserve: 0.2}}{battery}",
        *_failsafes(setup),
        "",
    ]
    if answers.camera:
        lines += [
            _noted("devices:", "sources of sensor data"),
            f"  ground_camera: {answers.camera!r}",
            "",
        ]
    return "\n".join([*lines, *_changes(kind, answers, acceleration.value, readings)]).rstrip() + "\n"


def _answered(name: str, answer: float, readings: Mapping[str, Reading]) -> Reading:
    """An answer, with its source if it equals the read value."""
    read = readings.get(name)
    return read if read is not None and read.value == answer else Reading(answer, "")


def _limit(name: str, reading: Reading, what: str = "", most: float = inf) -> str:
    """The line of a limit that is no more than another."""
    source = reading.source if reading.value <= most else f"{reading.source}, limited to {most:g}"
    notes = "; ".join(note for note in (what, source) if note)
    line = f"  {name}: {min(reading.value, most):g}"
    return _noted(line, notes) if notes else line


def _limits(
    kind: VehicleKind, answers: Answers, readings: Mapping[str, Reading], acceleration: Reading
) -> Iterator[str]:
    """Limits that were read or answered, or else consistent assumptions."""
    speed_m_s, height_max_m = answers.speed_m_s, answers.height_max_m
    yield _limit("speed_m_s", _answered("speed_m_s", speed_m_s, readings))
    yield _limit("climb_m_s", readings.get("climb_m_s", Reading(kind.climb_m_s, ASSUMED)), most=speed_m_s)
    landing = readings.get("landing_m_s", Reading(kind.landing_m_s, ASSUMED))
    yield _limit("landing_m_s", landing, "in the last part of a landing")
    yield _limit("acceleration_m_s2", acceleration)
    height_min_m = min(kind.heights_m[0], 0.5 * height_max_m)
    yield _limit("height_min_m", Reading(height_min_m, ASSUMED), "of waypoints, above home")
    yield _limit("height_max_m", _answered("height_max_m", height_max_m, readings))
    yield _limit(
        "fence_margin_m",
        Reading(kind.fence_margin_m, ASSUMED),
        "that waypoints and legs keep from a mission's fence",
    )
    most = {"survey_height_m": height_max_m, "survey_speed_m_s": speed_m_s, "speed_min_m_s": speed_m_s}
    for name, (assumed, what) in kind.more.items():
        reading = readings.get(name, Reading(assumed, ASSUMED))
        yield _limit(name, reading, what, most.get(name, inf))
        if name == "survey_speed_m_s":
            most["speed_min_m_s"] = min(reading.value, speed_m_s)


def _frame(origin_geo: tuple[float, float, float] | None) -> list[str]:
    if origin_geo is None:
        return [
            "# The autopilot had no position: without frames, missions use geographic coordinates only. For example:",
            "# frames: {site: {origin: {geo: [39.5528, 2.6285, 2.0]}, x_axis_bearing_deg: 0}}",
        ]
    latitude, longitude, altitude = origin_geo
    geo = f"{latitude:.7f}, {longitude:.7f}, {altitude:.1f}"
    return [
        _noted("frames:", "in which missions are written: x, y to the left of it, height"),
        f"  site: {{origin: {{geo: [{geo}]}}, x_axis_bearing_deg: 0}}   # where it stood when this was made",
    ]


def _failsafes(setup: AutopilotSetup) -> Iterator[str]:
    """The autopilot's configured failsafes; actions that no platform file allows become comments."""
    table, request = table_of(setup.style or Style.PX4, setup.vehicle), setup.parameters.get
    rows, notes = [], []
    for name, failsafe in (
        ("link_loss", table.link_loss),
        ("low_battery", table.low_battery),
        ("pose_lost", table.pose_lost),
    ):
        action, source = action_of(setup, failsafe), _source(setup, failsafe)
        if action in ALLOWED:
            limit = failsafe.limit(request)
            when = (
                {"link_loss": f", after_s: {limit:g}", "low_battery": f", at: {limit:g}"}.get(name, "") if limit else ""
            )
            rows.append(f"  {name}: {{action: {action}{when}}}{source}")
        elif action is None:
            notes.append(f"# {name}: {failsafe.parameter} could not be read")
        elif action != CONTINUE:
            notes.append(f"# {name}: it would {action}, which no mission can be checked against{source}")
    yield _noted(f"failsafes:{'' if rows else ' {}'}", "from its parameters; the pre-flight checks compare them")
    yield from [*rows, *notes]


def _source(setup: AutopilotSetup, failsafe: Failsafe) -> str:
    value = setup.parameters.get(failsafe.parameter)
    return "" if value is None else f"   # {failsafe.parameter} {value:g}"


def _changes(
    kind: VehicleKind, answers: Answers, acceleration_m_s2: float, readings: Mapping[str, Reading]
) -> Iterator[str]:
    """What differs from the base: no camera, no arming, how briskly it moves."""
    if not answers.camera:
        yield _noted("capabilities:", "in addition to the base's; null removes one")
        yield f"  {RECORD_IMAGES}: null"
    rows = [] if answers.camera else [f"{{name: {name}, class: null}}" for name in CAMERA]
    cruise = readings.get("survey_speed_m_s")
    setting_off = ["arm: false"] * (not answers.arm) + ([f"cruise_m_s: {cruise.value:g}"] if cruise is not None else [])
    setting_off += [f"tolerance_m: {kind.tolerance_m:g}"] * (kind.tolerance_m > 0.0)
    if setting_off:
        rows.append(f"{{name: {kind.sets_off}, settings: {{{', '.join(setting_off)}}}}}")
    if (braking := kind.braking_share) is not None:
        limit = f"acceleration_m_s2: {SHARE * acceleration_m_s2:g}"
        least = ""
        if kind.acceptance_m:
            at_rest_m_s = AT_REST_1_S * kind.acceptance_m
            least = f", least_acceptance_m: {kind.acceptance_m:g}, at_rest_m_s: {at_rest_m_s:g}"
        note = "   # plain satellites know no better where it is" if least else ""
        rows.append(f"{{name: waypoints, settings: {{{limit}{least}}}}}{note}")
        rows.append(f"{{name: hold, settings: {{braking_m_s2: {braking * acceleration_m_s2:g}}}}}")
        rows.append(f"{{name: teleoperate, settings: {{{limit}}}}}")
    if kind.at_rest_over_s:
        note = "   # waves move what stays where it is to and fro"
        rows.append(f"{{name: autopilot_driver, settings: {{at_rest_over_s: {kind.at_rest_over_s:g}}}}}{note}")
    if rows:
        yield _noted("components:", "changes to the base's, and additional ones")
        yield from (f"  - {row}" for row in rows)
