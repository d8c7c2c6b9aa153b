"""The optical follower on the tracker's camera in the hold: accuracy, covariance, loss of sight, a second light."""

from functools import partial
from typing import Any

import numpy as np
from tests.evidence.ground_flight import STANDING_M, motion, truths
from tests.evidence.page import Bar, Figure, Progress

from gloc3.errors import Misuse
from gloc3.messages.frames import rotate
from gloc3_onboard.algorithms.vision.optical_follower import FollowerSettings, OpticalFollower
from gloc3_sitl.world.rig import TRACKER, TRACKER_IMAGER
from gloc3_sitl.world.tracker import LED_FRD_M, TrackerCamera
from gloc3_sitl.world.world import World

SEEDS = range(5)
HEIGHT_STD_M = 0.03
DARK_S = (40.0, 45.0)
"""When the lamp is off."""
FOUND_WITHIN_S = 0.5


def tracker_in(world: World, seed: int) -> TrackerCamera:
    """The tracker's camera of a world.

    Raises:
        Misuse: the world has none.
    """
    if world.file.tracker is None:
        raise Misuse(f"{world.name} has no tracker")
    return TrackerCamera(world, world.file.tracker, TRACKER, TRACKER_IMAGER, seed)


def follower_in(camera: TrackerCamera) -> OpticalFollower:
    """A follower that knows where that camera is."""
    stand = FollowerSettings(
        position_ned_m=camera.position_ned_m, ned_from_frd=camera.ned_from_frd, lever_frd_m=LED_FRD_M
    )
    return OpticalFollower(TRACKER, stand)


def flight(seed: int, world_name: str = "hold") -> dict[str, Any]:
    """Follows a flight; the lamp goes out for a while."""
    world = World.load(world_name)
    camera = tracker_in(world, seed)
    follower, random = follower_in(camera), np.random.default_rng(seed)
    errors, squares, dark, lost, found_s = [], [], 0, 0, float("nan")
    for truth in truths(world, motion(seed)):
        camera.is_lit = not DARK_S[0] <= truth.t_s < DARK_S[1]
        x, y, height = world.local(truth.latitude_deg, truth.longitude_deg, truth.altitude_m)
        lever = rotate(truth.attitude_wxyz, LED_FRD_M)
        north, east, down = world.frame.to_ned((x, y, height + STANDING_M))
        lamp = np.array([north, east, down]) + np.array(lever)
        given_m = float(lamp[2] + HEIGHT_STD_M * random.standard_normal())
        fix = follower.update(camera.capture(truth).pixels, truth.t_s, given_m, HEIGHT_STD_M)
        if not camera.is_lit:
            dark += fix.is_valid
            continue
        if not fix.is_valid:
            lost += 1
            continue
        if truth.t_s >= DARK_S[1] and np.isnan(found_s):
            found_s = truth.t_s - DARK_S[1]
        error = np.array(fix.position_ned_m) - lamp
        covariance = np.array(fix.covariance).reshape(3, 3)
        errors.append(float(error @ error))
        squares.append(float(error @ np.linalg.solve(covariance, error)) / 3.0)
    return {
        "rms": float(np.sqrt(np.mean(errors))) if errors else float("nan"),
        "square": float(np.mean(squares)) if squares else float("nan"),
        "beyond": float(np.mean(np.array(squares) > 7.81 / 3.0)) if squares else 1.0,
        "dark": dark,
        "lost": lost,
        "found_s": found_s,
        "count": len(errors),
        "worst": float(np.sqrt(max(errors))) if errors else float("nan"),
    }


def run(progress: Progress) -> list[Figure]:
    """The bar."""
    flights = []
    for seed in SEEDS:
        progress.report(f"seed {seed}")
        flights.append(progress.part(f"hold {seed}", partial(flight, seed)))
    square = float(np.mean([each["square"] for each in flights]))
    beyond = float(np.mean([each["beyond"] for each in flights]))
    found_s = max(each["found_s"] for each in flights)
    dark = sum(each["dark"] for each in flights)
    busy = progress.part("hold_busy", partial(flight, 0, "hold_busy"))
    return [
        Figure("error of position, RMS, m", f"{max(each['rms'] for each in flights):.3f}, worst seed"),
        Figure("fixes", f"{sum(each['count'] for each in flights)}; {sum(each['lost'] for each in flights)} without"),
        Figure("normalised squared error (1 is honest)", f"{square:.2f}", "0.2 to 1.3", 0.2 <= square <= 1.3),
        Figure("fixes beyond the 95 % bound of their covariance", f"{beyond:.1%}", "≤ 5 %", beyond <= 0.05),
        Figure("fixes while the lamp is off", str(dark), "0", dark == 0),
        Figure(
            "lamp found again, worst, s after it came back",
            f"{found_s:.2f}",
            f"≤ {FOUND_WITHIN_S}",
            found_s <= FOUND_WITHIN_S,
        ),
        Figure("with other lights about: error RMS, m", f"{busy['rms']:.3f}"),
        Figure("… worst error, m", f"{busy['worst']:.2f}", "≤ 0.5", not busy["worst"] > 0.5),
        Figure("… fixes", f"{busy['count']}; {busy['lost']} without"),
    ]


BARS = (
    Bar(
        "optical-follower",
        "The optical follower locates the vehicle's lamp and takes no other light for it",
        "The follower locates the lamp on the vehicle through the tracker's camera with an honest covariance. It "
        "reports the loss of the lamp, finds it again, and never takes another light for it.",
        run,
        seeds="0 to 4",
    ),
)
