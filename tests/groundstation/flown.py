"""A flight along a mission's path, told by a scripted platform at times of the test's own."""

from collections.abc import Iterator
from itertools import pairwise
from math import atan2, cos, degrees, dist, hypot, pi, sin

import msgspec

from gloc3.messages.frames import Vector3
from gloc3.messages.motion import MotionSummary, SiteSummary
from gloc3.messages.summaries import MissionSummary
from gloc3.mission.examples import find_mission
from gloc3.mission.model.model import digest_of
from gloc3_groundstation.mapping.requested import requested

from .station_scene import Scene

SITE = SiteSummary(frame="hold", x_axis_bearing_deg=0.0, origin_geo=(39.5528, 2.6285, 2.0), home_m=(0.0, 0.0, 0.0))
TEXT = (
    find_mission("inspection")
    .read_text()
    .replace("ceiling_m: 8}", "ceiling_m: 8, keep_out: [{polygon_m: [[13, -2], [17, -2], [17, 2], [14, 3]]}]}")
)
PERIOD_S = 0.25
FLOWN = ("map", "data")
"""Screens that show a flight."""


def path_of(text: str = TEXT, site: SiteSummary = SITE) -> tuple[Vector3, ...]:
    found = requested(text, site)
    assert found is not None
    return found.path_ned_m


def along(path: tuple[Vector3, ...], speed_m_s: float) -> Iterator[tuple[Vector3, Vector3]]:
    """Position and velocity (NED), four times a second."""
    for a, b in pairwise(path):
        length_m = dist(a, b)
        steps = max(1, round(length_m / speed_m_s / PERIOD_S))
        velocity = tuple((q - p) / (steps * PERIOD_S) for p, q in zip(a, b, strict=True))
        for n in range(steps):
            position = tuple(p + (q - p) * n / steps for p, q in zip(a, b, strict=True))
            yield position, velocity  # type: ignore[misc]


class Flight:
    """Has the scene's platform fly; the station's clock is the test's."""

    def __init__(self, here: Scene) -> None:
        self.here = here
        self.now_s = here.station.started_s + 700.0
        here.station.now_s = lambda: self.now_s  # type: ignore[misc]
        self.platform = here.platform
        self.platform.text = TEXT
        self.platform.mission = MissionSummary(
            name="cargo hold inspection",
            digest=digest_of(TEXT),
            state="running",
            tasks={
                **dict.fromkeys(("depart", "depart.climb"), "done"),
                **dict.fromkeys(("sweep", "sweep.wall", "sweep.photos"), "running"),
                **dict.fromkeys(("recover", "recover.home", "recover.down"), "waiting"),
            },
            progress={"sweep.wall": 0.6},
        )

    def begin(self) -> None:
        self.platform.report("site", SITE)
        self.platform.report("mission", msgspec.structs.replace(self.platform.mission, state="waiting"))
        self.platform.speak()

    def fly(self, seconds: float, speed_m_s: float = 0.5) -> None:
        """Along the path, a little beside it, as a gust would have it."""
        t_s, heading = 0.0, 0.0
        for position, velocity in along(path_of(), speed_m_s):
            if t_s > seconds:
                break
            if hypot(*velocity[:2]) > 0.05:
                heading = degrees(atan2(velocity[1], velocity[0]))
            self.move(t_s, position, velocity, heading)
            t_s += PERIOD_S
            self.now_s += PERIOD_S

    def move(self, t_s: float, position: Vector3, velocity: Vector3, heading_deg: float) -> None:
        drift_m = 0.25 * sin(t_s / 3.0) * min(1.0, t_s / 5.0)
        x, y, height = position[0] + drift_m * sin(t_s), -position[1] + drift_m, max(0.0, -position[2] + 0.3 * drift_m)
        charge = 97 - round(t_s / 4.0)
        self.platform.report(
            "motion",
            MotionSummary(
                t_s=t_s,
                attitude_cdeg=(
                    round(900 * sin(t_s / 3.0)),
                    round(-400 * cos(t_s / 5.0)),
                    round(100 * (heading_deg + 6.0 * sin(t_s))) % 36000,
                ),
                position_cm=(round(100 * x), round(100 * y), round(100 * height)),
                velocity_cm_s=(
                    round(100 * velocity[0] + 8 * sin(2 * t_s)),
                    round(-100 * velocity[1]),
                    round(-100 * velocity[2] + 6 * sin(t_s * pi)),
                ),
                is_pose_valid=True,
                setpoint_cm=(round(100 * position[0]), round(-100 * position[1]), round(-100 * position[2])),
                setpoint_velocity_cm_s=(round(100 * velocity[0]), round(-100 * velocity[1]), round(-100 * velocity[2])),
                setpoint_heading_cdeg=round(100 * heading_deg) % 36000,
                covariance_cm2=(900, 300, 400),
                height_std_cm=10,
                battery_cv=1640 - round(t_s),
                battery_ca=1450 + round(120 * sin(t_s / 2.0)),
            ),
        )
        self.platform.fly(
            t_s=t_s,
            is_armed=True,
            mode="OFFBOARD",
            landed="in_air",
            position_m=(round(x, 2), round(y, 2), round(height, 2)),
            speed_m_s=round(hypot(*velocity), 2),
            heading_deg=round(heading_deg) % 360,
            battery_percent=charge,
        )
        if t_s % 1.0 == 0.0:
            self.platform.speak()


async def flown_on_the_map(here: Scene, seconds: float) -> Flight:
    """Has the platform fly for a time, and shows it on the map."""
    flight = Flight(here)
    flight.begin()
    flight.fly(seconds)
    await here.go("4")
    await here.until("map", "heron")
    return flight
