"""The inertial unit as a witness: its motion alone, and which of the sources it contradicts."""

import numpy as np
import pytest

from gloc3_onboard.algorithms.fusion.inertial import Inertial
from gloc3_onboard.algorithms.fusion.pose_fusion import PoseFusion

from .flown import inspection, sensors_of
from .fly import Recorder, fly
from .outliers import BEGIN_S


class Shadowed(PoseFusion):
    """Another inertial solution goes on from a moment without any correction; what it says is compared."""

    BEGIN_S, END_S = 8.75, 10.75

    def __init__(self) -> None:
        super().__init__(Recorder.SETTINGS)
        self.shadow: Inertial | None = None
        self.begins_m: list[np.ndarray] = []
        self.found_m = self.expected_m = np.zeros(3)
        move = self.estimate.move

        def both(rate: tuple[float, ...], force: tuple[float, ...], t_s: float, *, is_blind: bool = False) -> None:
            inertial = self.estimate.inertial
            if self.shadow is None and t_s > self.BEGIN_S:
                self.estimate.remember_motion()
                self.shadow = Inertial()
                self.shadow.gyroscope_bias_rad_s = inertial.gyroscope_bias_rad_s
                self.shadow.accelerometer_bias_m_s2 = inertial.accelerometer_bias_m_s2
                self.shadow.place(inertial.now)
                self.begin_s, self.followed_m = inertial.now.t_s, np.array(inertial.now.position_ned_m)
            before = np.array(inertial.now.position_ned_m)
            move(rate, force, t_s, is_blind=is_blind)  # type: ignore[arg-type]
            if self.shadow is not None:
                self.shadow.move(rate, force, t_s)  # type: ignore[arg-type]
                self.followed_m = self.followed_m + np.array(inertial.now.position_ned_m) - before
                if abs(t_s - self.END_S) < 1e-6:
                    excess = self.estimate.alone.excess(self.begin_s, t_s)
                    assert excess is not None
                    self.found_m = excess[0]
                    self.expected_m = np.array(self.shadow.now.position_ned_m) - self.followed_m

        self.estimate.move = both  # type: ignore[method-assign]


def test_the_motion_of_the_inertial_unit_alone_is_what_it_measures_without_any_correction() -> None:
    sensors = sensors_of("hummingbird", 4)
    for sensor in sensors:
        if sensor.name in ("stereo", "tracker"):
            sensor.fault, sensor.fault_s = "ramp", (BEGIN_S, 1e9)
    fusion = Shadowed()
    fly(inspection(), sensors, 4, until_s=11.0, fusion=fusion)
    assert np.linalg.norm(fusion.expected_m) > 0.05, "the wrong sources have moved the estimate"
    assert fusion.found_m == pytest.approx(fusion.expected_m, abs=0.003)


@pytest.mark.parametrize(
    ("faults", "until_s"),
    [
        ({"ground": "ramp"}, 12.0),
        ({"stereo": "ramp", "tracker": "ramp"}, 12.0),
        ({"stereo": "scale", "ground": "scale"}, 12.5),
    ],
)
def test_who_begins_to_move_without_an_acceleration_is_known_whether_they_are_few_or_most(
    faults: dict[str, str], until_s: float
) -> None:
    for seed in (3, 4):
        sensors = sensors_of("hummingbird", seed)
        for sensor in sensors:
            if sensor.name in faults:
                sensor.fault, sensor.fault_s = faults[sensor.name], (BEGIN_S, 1e9)
        found: set[str] = set()
        fusion = PoseFusion(Recorder.SETTINGS)
        tick, witness = fusion.tick, fusion._voting.isolation.witness

        def watched(now_s: float, tick=tick, witness=witness, found=found) -> None:  # type: ignore[no-untyped-def]
            tick(now_s)
            found |= witness.against

        fusion.tick = watched  # type: ignore[method-assign]
        fly(inspection(), sensors, seed, until_s=until_s, fusion=fusion)
        assert found
        assert found <= set(faults)


def test_in_a_good_flight_the_inertial_unit_contradicts_nobody() -> None:
    fusion = PoseFusion(Recorder.SETTINGS)
    flown = fly(inspection(), sensors_of("hummingbird", 5), 5, until_s=14.0, fusion=fusion)
    assert not fusion._voting.isolation.witness.against
    assert max(max(pose.position_std_m) for pose in flown.poses[200:]) < 0.08
