"""The command `gloc3 sitl record`: a smooth flight through a world, written as a data set with its truth."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final

from cyclopts import Parameter

from gloc3.cli.narration import narrate
from gloc3.errors import Refused
from gloc3.messages.frames import Vector3
from gloc3_sitl.sequences.smooth_flight import SmoothFlight
from gloc3_sitl.world import World

LEAST_CLEARANCE_M: Final = 0.3
MOST_LAP_M: Final = 100.0
"""Sides of the default lap."""
MOST_S: Final = 3600.0
"""Longest recording without `--seconds`."""
_POLL_PERIOD_S: Final = 0.1


class DataSetFormat(StrEnum):
    """Format of a recorded data set."""

    KITTI = "kitti"
    """Rectified stereo pictures, as the odometry benchmark has them."""
    EUROC = "euroc"
    """Stereo pictures with distortion, and an inertial unit."""
    GROUND = "ground"
    """Pictures straight down, with attitude and height."""
    CARMEN = "carmen"
    """A log of laser scans."""


def record(
    form: DataSetFormat,
    out: Path,
    /,
    *,
    world: str = "hold",
    way: Annotated[list[str] | None, Parameter(negative=())] = None,
    speed: float = 0.5,
    height: float = 1.5,
    rate: float | None = None,
    seconds: float | None = None,
    seed: int = 0,
) -> int:
    """Fly smoothly through a world, without physics, and record the sensor data with ground truth as a data set.

    For example:

    - `gloc3 sitl record euroc hold`: a lap of the cargo hold for `gloc3 odometry stereo hold`
    - `gloc3 sitl record carmen tank.log --world tank --seconds 60`: a minute of laser scans for `gloc3 odometry laser`
    - `gloc3 sitl record ground down --way 3,3,2 --way 12,3,2 --way 12,8,2`: along a path of your own

    Args:
        form: kitti (rectified stereo), euroc (stereo with distortion, inertial unit), ground (pictures straight down, attitude,
            height along the body's down axis) or carmen (laser).
        out: A new or empty folder; with carmen a new file NAME.log.
        world: World: the name of a built-in one, or a world file.
        way: A corner of the path as X,Y,HEIGHT in the world's frame; repeated for each. Default: a lap in the middle.
        speed: Speed between the corners, in m/s.
        height: Height of the default lap over the floor, in metres.
        rate: Pictures or scans per second; default 15, or 10 for carmen.
        seconds: Time after which to end, in seconds.
        seed: Seed of all noise.
    """
    if not 0.0 < speed <= 5.0:
        raise Refused("--speed must be above 0 and at most 5 m/s")
    if rate is not None and not 0.0 < rate <= 100.0:
        raise Refused("--rate must be above 0 and at most 100 Hz")
    if seconds is not None and not seconds > 0.0:
        raise Refused("--seconds must be above 0")
    if seed < 0:
        raise Refused("--seed must be 0 or more")
    if form is DataSetFormat.CARMEN and out.suffix not in (".log", ".clf"):
        raise Refused(f"name the CARMEN log {out}.log, so that gloc3 odometry laser and carmen:// recognise it")
    if out.exists() and (form is DataSetFormat.CARMEN or not out.is_dir() or any(out.iterdir())):
        raise Refused(f"{out} already exists and is not empty")
    place = World.load(world)
    flight = SmoothFlight(place, [_corner(text) for text in way] if way else lap(place, height), speed)
    duration_s = min(flight.duration_s, seconds or flight.duration_s)
    if duration_s > MOST_S and seconds is None:
        raise Refused(f"the path takes {duration_s:.0f} s; limit it with --seconds")
    _check_clear(place, flight, duration_s)
    count = _write(form, out, place, flight, duration_s, rate, seed)
    what = {DataSetFormat.CARMEN: "scans", DataSetFormat.GROUND: "pictures"}.get(form, "pairs of pictures")
    narrate(f"record: {count} {what} in {duration_s:.1f} s, {flight.length_m:.1f} m path in all, written to {out}")
    return 0


def lap(world: World, height_m: float) -> list[Vector3]:
    """Returns a lap in the middle of a world's floor.

    Raises:
        Refused: it has no surface called *floor*.
    """
    floor = world.file.surfaces.get("floor")
    if floor is None:
        raise Refused(f"the world {world.name} has no surface called floor; give the corners with --way")
    corner, opposite = (
        floor.corner_m,
        tuple(sum(parts) for parts in zip(floor.corner_m, floor.across_m, floor.down_m, strict=True)),
    )
    sides = []
    for begin, end in zip(corner[:2], opposite[:2], strict=True):
        low, high = min(begin, end), max(begin, end)
        inset = max(min(0.35 * (high - low), 4.0), 0.5 * (high - low - MOST_LAP_M))
        sides.append((low + inset, high - inset))
    (x0, x1), (y0, y1) = sides
    z = corner[2] + height_m
    return [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z), (x0, y0, z)]


def _corner(text: str) -> Vector3:
    parts = text.split(",")
    try:
        x, y, height = (float(part) for part in parts)
    except ValueError:
        raise Refused(f"--way {text!r} must be X,Y,HEIGHT in metres") from None
    return (x, y, height)


def _check_clear(world: World, flight: SmoothFlight, duration_s: float) -> None:
    """Refuses a path that comes too near to an obstacle."""
    for number in range(int(duration_s / _POLL_PERIOD_S) + 1):
        t_s = number * _POLL_PERIOD_S
        place = flight.place_m(t_s)
        clearance_m = world.geometry.clearance_m(place, t_s)
        if clearance_m < LEAST_CLEARANCE_M:
            where = ", ".join(f"{part:.1f}" for part in place)
            raise Refused(f"the path passes within {clearance_m:.2f} m of an obstacle, at {where} after {t_s:.1f} s")


def _write(
    form: DataSetFormat,
    out: Path,
    world: World,
    flight: SmoothFlight,
    duration_s: float,
    rate_hz: float | None,
    seed: int,
) -> int:
    """Writes the data set; how many pictures or scans it has."""
    if form is DataSetFormat.EUROC:
        from gloc3_sitl.sequences.euroc import write_euroc

        return write_euroc(out, world, flight.truth, duration_s, rate_hz=rate_hz or 15.0, seed=seed)
    steps_hz = rate_hz or (10.0 if form is DataSetFormat.CARMEN else 15.0)
    truths = (flight.truth(number / steps_hz) for number in range(int(duration_s * steps_hz) + 1))
    if form is DataSetFormat.CARMEN:
        from gloc3_sitl.sequences.carmen import write_carmen

        return write_carmen(out, world, truths, seed=seed)
    if form is DataSetFormat.GROUND:
        from gloc3_sitl.sequences.ground import write_ground

        return write_ground(out, world, truths, rate_hz=steps_hz, seed=seed)
    from gloc3_sitl.sequences.kitti import write_kitti

    return write_kitti(out, world, truths, seed=seed)
