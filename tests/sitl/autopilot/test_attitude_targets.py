"""Attitudes and rates as streamed setpoints."""

from math import radians

import pytest

from gloc3.messages.frames import Quaternion, from_euler, to_euler
from gloc3_sitl.autopilot.modes import Result

from .bench import Bench

pytestmark = pytest.mark.flight

IGNORE_RATES, IGNORE_ATTITUDE = 7, 128


def stream(
    bench: Bench, seconds: float, *, q: Quaternion, thrust: float, mask: int = IGNORE_RATES, roll_rate: float = 0.0
) -> None:
    for _ in range(round(seconds * 20)):
        bench.send(
            "SET_ATTITUDE_TARGET",
            target_system=1,
            target_component=1,
            type_mask=mask,
            q=q,
            thrust=thrust,
            body_roll_rate=roll_rate,
        )
        bench.run(0.05)


@pytest.mark.parametrize(("style", "thrust"), [("px4", 0.465), ("ardupilot", 0.5)])
def test_a_lean_accelerates_and_a_lost_stream_stops(style: str, thrust: float) -> None:
    bench = Bench(style)
    bench.take_off(5.0)
    lean = from_euler(0.0, radians(-5.0), 0.0)
    stream(bench, 1.0, q=lean, thrust=thrust)
    assert bench.set_mode("Offboard" if bench.is_px4 else "GUIDED") is Result.ACCEPTED
    stream(bench, 2.0, q=lean, thrust=thrust)
    assert to_euler(bench.sim.truth().attitude_wxyz)[1] == pytest.approx(radians(-5.0), abs=radians(1.0))
    assert bench.sim.truth().velocity_ned_m_s[0] > 1.0
    bench.run(8.0)
    assert abs(bench.sim.truth().velocity_ned_m_s[0]) < 0.2


def test_ardupilot_flies_attitudes_without_a_position_and_levels_when_they_end() -> None:
    bench = Bench("ardupilot")
    bench.take_off(4.0)
    assert bench.set_mode("GUIDED_NOGPS") is Result.ACCEPTED
    bench.sim.sensors.fail("fix", "lost")
    stream(bench, 2.0, q=from_euler(radians(4.0), 0.0, 0.0), thrust=0.5)
    assert bench.mode == "GUIDED_NOGPS"
    assert bench.sim.truth().velocity_ned_m_s[1] > 0.8
    bench.run(4.0)
    roll, pitch, _ = to_euler(bench.sim.truth().attitude_wxyz)
    assert abs(roll) < radians(3.0)
    assert abs(pitch) < radians(3.0)
    assert abs(bench.sim.truth().velocity_ned_m_s[2]) < 0.2


def test_rates_alone_are_flown_by_px4() -> None:
    bench = Bench()
    bench.take_off(5.0)
    stream(bench, 0.8, q=from_euler(0.0, 0.0, 0.0), thrust=0.465)
    bench.set_mode("Offboard")
    stream(bench, 0.5, q=from_euler(0.0, 0.0, 0.0), thrust=0.465, mask=IGNORE_ATTITUDE, roll_rate=0.3)
    assert to_euler(bench.sim.truth().attitude_wxyz)[0] > radians(4.0)


@pytest.mark.parametrize(
    "fields", [{"q": (0.0, 0.0, 0.0, 0.0)}, {"q": (float("nan"),) * 4}, {"thrust": float("nan")}, {"type_mask": 135}]
)
def test_targets_that_make_no_sense_are_refused(fields: dict[str, object]) -> None:
    bench = Bench()
    values = {"type_mask": IGNORE_RATES, "q": from_euler(0.0, 0.0, 0.0), "thrust": 0.5, **fields}
    bench.send("SET_ATTITUDE_TARGET", target_system=1, target_component=1, **values)
    assert bench.sim.front.refused_setpoints == 1
