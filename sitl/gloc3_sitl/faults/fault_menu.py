"""What can go wrong in a flight: every fault that fits its platform, world and mission, without times."""

from collections.abc import Iterator
from math import inf
from typing import Final, NamedTuple

from gloc3.errors import Refused
from gloc3_sitl.faults.fault_effects import AWAY_S, EFFECTS, SCALED, SENSORS, devices_of, words_of
from gloc3_sitl.faults.faults import read_fault
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.sensors.sensor import FaultMode

PILOT_MODES: Final = ("manual", "position", "hold", "return", "land")
STEERS: Final = ("pause", "resume", "skip", "abort", "retry", "start")
CORRUPTED: Final = {
    "autopilot_pose": ("lost", "late", "nan"),
    "pose": ("lost", "late", "nan"),
    "setpoint": ("lost", "late", "stale", "nan", "jump", "foreign"),
    "autopilot": ("lost", "late"),
}
"""Topics whose messages are corrupted on their way, and how. A position that is wrong in transit and nowhere else, stamp and
all, is no fault of anything real: its sensors go wrong instead."""


class PossibleFault(NamedTuple):
    """A fault without its times."""

    text: str
    """With `{}` for a value that is drawn."""
    values: tuple[float, float] | None = None
    """From where to where the value is drawn; None where there is none."""
    is_event: bool = False
    """It has no end."""
    longest_s: float = inf
    """Longer than this it is not drawn; infinite for up to the end of the flight."""
    group: str = ""
    """What is drawn about as often as everything else of another group."""


def possible_faults(flight: Flight) -> list[PossibleFault]:
    """Lists what can go wrong in a flight, in a fixed order."""
    return [one for one in _all(flight) if _is_possible(flight, one)]


def _is_possible(flight: Flight, possible: PossibleFault) -> bool:
    """Whether a fault fits the flight."""
    value = "" if possible.values is None else f"{possible.values[0]:g}"
    fault = read_fault(possible.text.replace("{}", value))
    try:
        EFFECTS[fault.kind].check(flight, fault.given)
    except Refused:
        return False
    return True


def _all(flight: Flight) -> Iterator[PossibleFault]:
    yield from _links()
    yield from _surroundings(flight)
    yield from _components(flight)
    yield from _sensors(flight)
    yield from _people(flight)
    yield from _topics()


def _links() -> Iterator[PossibleFault]:
    for name in ("link", "cable"):
        yield PossibleFault(f"{name}_loss", group=name)
        yield PossibleFault(f"{name}_loss={{}}", (0.05, 0.8), group=name)
        yield PossibleFault(f"{name}_slow={{}}", (0.05, 3.0), group=name)
        yield PossibleFault(f"{name}_twice={{}}", (0.1, 1.0), group=name)


def _surroundings(flight: Flight) -> Iterator[PossibleFault]:
    yield PossibleFault("wind={}", (2.0, 10.0), group="weather")
    yield PossibleFault("current={}", (0.05, 0.6), group="weather")
    yield PossibleFault("battery={}", (0.02, 0.3), is_event=True, group="battery")
    least = 0.75 if flight.platform.vehicle.type in ("quadrotor", "hexarotor", "aircraft") else 0.0
    for number in range(1, 9):
        yield PossibleFault(f"motor:{number}={{}}", (least, 0.95), group="motor")
    yield PossibleFault("restart", longest_s=10.0 * AWAY_S, group="computer")
    yield PossibleFault("disk_full", group="computer")
    yield PossibleFault("clock_jump={}", (-1e6, 1e6), is_event=True, group="computer")


def _components(flight: Flight) -> Iterator[PossibleFault]:
    for row in flight.platform.components:
        name = row.name
        yield PossibleFault(f"crash:{name}", is_event=True, group="crash")
        yield PossibleFault(f"crash:{name}", longest_s=60.0, group="crash")
        yield PossibleFault(f"hang:{name}", longest_s=60.0, group="hang")
        yield PossibleFault(f"slow:{name}={{}}", (0.01, 0.5), longest_s=60.0, group="slow")
        yield PossibleFault(f"leak:{name}={{}}", (0.0001, 0.01), longest_s=60.0, group="slow")


def _sensors(flight: Flight) -> Iterator[PossibleFault]:
    for name in SENSORS:
        for mode in FaultMode:
            if mode is not FaultMode.SCALED or name in SCALED:
                yield PossibleFault(f"sensor:{name}={mode}", group="sensor")
    for name, device in sorted(devices_of(flight).items()):
        for word in words_of(name, device):
            yield PossibleFault(f"device:{name}={word}", group="device")


def _people(flight: Flight) -> Iterator[PossibleFault]:
    for mode in PILOT_MODES:
        yield PossibleFault(f"pilot:{mode}", is_event=True, group="pilot")
    yield PossibleFault("pilot:off", is_event=True, group="pilot")
    for verb in STEERS:
        yield PossibleFault(f"operator:{verb}", is_event=True, group="operator")
    for key in ("hold", "land"):
        yield PossibleFault(f"operator:{key}", is_event=True, group="operator")
    for target in (*flight.mission.tasks, *flight.mission.actions()):
        for verb in ("pause", "resume", "skip", "abort"):
            yield PossibleFault(f"operator:{verb}={target}", is_event=True, group="operator")


def _topics() -> Iterator[PossibleFault]:
    for topic, words in CORRUPTED.items():
        for word in words:
            yield PossibleFault(f"topic:{topic}={word}", longest_s=30.0, group="topic")
