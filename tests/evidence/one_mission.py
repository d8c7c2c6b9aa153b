"""One mission file for several vehicles: what is the same, what differs, and the path of each."""

from collections.abc import Sequence
from functools import partial
from hashlib import sha256
from typing import Any, NamedTuple

import msgspec
from tests.evidence.page import PAGES, Bar, Figure, Progress
from tests.evidence.ways import Around, draw, lost, missed_m

from gloc3.mission.examples import find_mission
from gloc3.platform.reader import load_platform

LIMITS = ("speed_m_s", "survey_height_m", "survey_speed_m_s", "survey_acceptance_m")


class Party(NamedTuple):
    """One mission, and who carries it out."""

    mission: str
    platforms: Sequence[str]
    miss_m: Sequence[float]
    """What the farthest true miss of a waypoint must stay below, one each."""


PARTIES = (
    Party("inspection", ("pelican", "hummingbird"), (0.3, 0.3)),
    Party("survey", ("boat", "auv", "rover"), (1.0, 5.0, 0.3)),
)


def picture(mission: str, platform: str) -> str:
    """The name of a path's picture."""
    return f"{mission}_{platform}.svg"


def carried_out(mission: str, platform: str) -> dict[str, Any]:
    """What came of one, and its picture."""
    way = lost(mission, platform, Around(), seed=1)
    draw(way, PAGES / picture(mission, platform), f"{mission} by {platform}: path requested and path followed")
    return {"state": way.state, "miss_m": missed_m(way.true, way.requested), "waypoints": len(way.requested) - 1}


def one_mission(progress: Progress) -> list[Figure]:
    """One row for the file, and some for each vehicle."""
    figures: list[Figure] = []
    for party in PARTIES:
        digest = sha256(find_mission(party.mission).read_bytes()).hexdigest()
        figures.append(Figure(f"`{party.mission}`, digest of the file that each is given", digest[:16]))
        for platform, most_m in zip(party.platforms, party.miss_m, strict=True):
            progress.report(f"{party.mission} {platform}")
            run = progress.part(f"{party.mission} {platform}", partial(carried_out, party.mission, platform))
            limits = msgspec.to_builtins(load_platform(platform).limits)
            of = ", ".join(f"{name} {limits[name]:g}" for name in LIMITS if limits.get(name) is not None)
            name = f"{party.mission} by {platform}"
            figures += [
                Figure(f"{name}: the mission", run["state"], "done", run["state"] == "done"),
                Figure(
                    f"{name}: farthest true miss of {run['waypoints']} waypoints",
                    f"{run['miss_m']:.2f} m",
                    f"≤ {most_m:g} m",
                    run["miss_m"] <= most_m,
                ),
                Figure(f"{name}: limits of its platform", of),
            ]
    return figures


BARS = (
    Bar(
        "one-mission",
        "One mission file is flown, sailed, dived and driven by different vehicles",
        "Two multirotors fly the inspection of the hold without satellites, one with a laser scanner and one without. "
        "The boat sails, the AUV dives and the rover drives the survey. Each gets the same file; heights, speeds and "
        "ways to depart that the file does not give come from the limits and capabilities of the platform. The AUV "
        "misses by the error of the satellite fixes from which it dives.",
        one_mission,
        seeds="1",
        pictures=tuple(picture(party.mission, platform) for party in PARTIES for platform in party.platforms),
    ),
)
