"""What the cases of PX4's own integration tests have in common: a bench that is ready, and steps of a flight."""

from collections.abc import Callable
from math import hypot, nan

from tests.sitl.autopilot.bench import ARM, REPOSITION, TAKE_OFF, Bench

from gloc3.mavlink.services.plan import PlanItem, PlanResult, PlanType
from gloc3_sitl.autopilot.mission import MissionState
from gloc3_sitl.autopilot.modes import Result

WAYPOINT, RETURN, MISSION_START = 16, 20, 300


def ready(**parameters: float) -> Bench:
    bench = Bench()
    for name, value in {"RTL_RETURN_ALT": 8.0, "RTL_DESCEND_ALT": 5.0, **parameters}.items():
        bench.set_parameter(name, value)
    bench.get_ready()
    return bench


def arm(bench: Bench) -> None:
    assert bench.command(ARM, 1) is Result.ACCEPTED


def hover(bench: Bench) -> None:
    """Arms, takes off, and waits until it hovers."""
    arm(bench)
    assert bench.command(TAKE_OFF, nan, 0, 0, nan, nan, nan, nan) is Result.ACCEPTED
    bench.run_until(lambda: bench.mode == "Hold", 30.0)
    bench.run(2.0)


def return_home(bench: Bench) -> None:
    assert bench.command(RETURN) is Result.ACCEPTED
    bench.run_until(lambda: not bench.is_armed, 180.0)


def square(bench: Bench, leg_m: float = 20.0, height_m: float = 10.0) -> list[PlanItem]:
    corners = ((leg_m, 0.0), (leg_m, leg_m), (0.0, leg_m))
    return [bench.item(WAYPOINT, north, east, height_m, param2=1.0) for north, east in corners]


def upload(bench: Bench, *items: PlanItem, kind: PlanType = PlanType.MISSION) -> None:
    assert bench.upload(items, kind) is PlanResult.ACCEPTED


def start_mission(bench: Bench) -> None:
    assert bench.command(MISSION_START) is Result.ACCEPTED


def await_item(bench: Bench, number: int, within_s: float = 90.0) -> None:
    bench.run_until(lambda: bench.autopilot.craft.mission.current >= number, within_s)


def await_complete(bench: Bench, within_s: float = 180.0) -> None:
    bench.run_until(lambda: bench.autopilot.craft.mission.state is MissionState.COMPLETE, within_s)


def watch(bench: Bench, seconds: float, poll: Callable[[], None]) -> None:
    for _ in range(round(seconds / 0.1)):
        bench.run(0.1)
        poll()


def from_home_m(bench: Bench) -> float:
    return hypot(bench.position[0], bench.position[1])


def go(bench: Bench, north_m: float, east_m: float, height_m: float) -> Result:
    goal = bench.item(WAYPOINT, north_m, east_m)
    altitude = bench.sim.world.home.altitude_m + height_m
    return bench.command(REPOSITION, -1, 1, 0, nan, as_int={"frame": 5, "x": goal.x, "y": goal.y, "z": altitude})
