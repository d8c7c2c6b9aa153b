"""The inertial unit as a witness: its motion alone, and which of the sources it contradicts."""

from collections import deque
from collections.abc import Callable
from math import sin

import numpy as np
import pytest

from gloc3_onboard.algorithms.fusion.fault_isolation import FaultIsolation
from gloc3_onboard.algorithms.fusion.inertial import Inertial
from gloc3_onboard.algorithms.fusion.inertial_motion import InertialMotion
from gloc3_onboard.algorithms.fusion.pose_fusion import PoseFusion

from .flown import inspection, sensors_of
from .fly import Recorder, fly
from .outliers import BEGIN_S

Triple = tuple[float, ...]
Samples = Callable[[float, Triple, Triple], tuple[Triple, Triple] | None]


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


class Heard(PoseFusion):
    """Notes whom the inertial unit contradicts, at any time."""

    def __init__(self) -> None:
        super().__init__(Recorder.SETTINGS)
        self.accused: set[str] = set()
        self.is_doubted = False

    def tick(self, now_s: float) -> None:
        super().tick(now_s)
        witness = self._voting.isolation.witness
        self.accused |= witness.against
        self.is_doubted |= witness.is_doubted(now_s)


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
        fusion = Heard()
        fly(inspection(), sensors, seed, until_s=until_s, fusion=fusion)
        assert fusion.accused
        assert fusion.accused <= set(faults)
        assert not fusion.is_doubted


@pytest.mark.parametrize("speed_m_s", [0.8, 3.0])
def test_in_a_good_flight_the_inertial_unit_contradicts_nobody_and_nobody_it(speed_m_s: float) -> None:
    """At 3 m/s it leans by 25 degrees at each corner."""
    fusion = Heard()
    flown = fly(inspection(speed_m_s=speed_m_s), sensors_of("hummingbird", 5), 5, until_s=14.0, fusion=fusion)
    assert not fusion.accused
    assert not fusion.is_doubted
    assert max(max(pose.position_std_m) for pose in flown.poses[200:]) < 0.08


# --- where the inertial unit itself is wrong ---


def scaled(rates: float, forces: float) -> Samples:
    return lambda _, rate, force: (tuple(rates * value for value in rate), tuple(forces * value for value in force))


def biased(rate_rad_s: Triple, force_m_s2: Triple) -> Samples:
    def sample(_: float, rate: Triple, force: Triple) -> tuple[Triple, Triple]:
        return tuple(map(sum, zip(rate, rate_rad_s, strict=True))), tuple(map(sum, zip(force, force_m_s2, strict=True)))

    return sample


def struck(begin_s: float) -> Samples:
    """A blow for 10 ms, after which its accelerometers are biased."""
    afterwards = biased((0.0, 0.0, 0.0), (0.3, 0.0, 0.2))

    def sample(t_s: float, rate: Triple, force: Triple) -> tuple[Triple, Triple] | None:
        if t_s < begin_s + 0.005:
            return rate, (force[0] + 20.0, force[1], force[2] - 20.0)
        return afterwards(t_s, rate, force)

    return sample


def shaken(t_s: float, rate: Triple, force: Triple) -> tuple[Triple, Triple]:
    """A vibration that its rate of sampling turns into one of 0.5 Hz."""
    return rate, (force[0] + 0.1 * sin(3.1 * t_s), force[1], force[2] + 0.5 * sin(3.1 * t_s))


def late(by_s: float) -> Samples:
    before: deque[tuple[float, Triple, Triple]] = deque()

    def sample(t_s: float, rate: Triple, force: Triple) -> tuple[Triple, Triple] | None:
        before.append((t_s, rate, force))
        while before[0][0] < t_s - by_s - 1e-6:
            before.popleft()
        return before[0][1:]

    return sample


LIES: dict[str, Callable[[float], Samples]] = {
    "scaled": lambda _: scaled(1.05, 1.05),
    "gyroscopes scaled": lambda _: scaled(1.05, 1.0),
    "gyroscopes biased": lambda _: biased((0.01, 0.0, 0.03), (0.0, 0.0, 0.0)),
    "accelerometers biased a little": lambda _: biased((0.0, 0.0, 0.0), (0.05, 0.05, 0.0)),
    "accelerometers biased": lambda _: biased((0.0, 0.0, 0.0), (0.2, 0.3, 0.0)),
    "struck": struck,
    "shaken": lambda _: shaken,
    "frozen": lambda _: lambda _t_s, _rate, _force: ((0.0, 0.0, 0.0), (0.0, 0.0, -9.8)),
    "late": lambda _: late(0.1),
    "silent": lambda _: lambda _t_s, _rate, _force: None,
}


def with_lie(kind: str, begin_s: float, end_s: float) -> Samples:
    lie = LIES[kind](begin_s)
    return lambda t_s, rate, force: lie(t_s, rate, force) if begin_s <= t_s < end_s else (rate, force)


def accused(platform: str, kind: str, begin_s: float, until_s: float, speed_m_s: float = 0.8) -> tuple[set[str], bool]:
    """Whom such a unit accuses, and whether the pose was always valid."""
    fusion = Heard()
    seed = round(10.0 * begin_s)
    flown = fly(
        inspection(speed_m_s=speed_m_s),
        sensors_of(platform, seed),
        seed,
        imu=with_lie(kind, begin_s, begin_s + 5.0),
        until_s=until_s,
        fusion=fusion,
    )
    return fusion.accused, all(pose.is_valid for pose in flown.poses)


@pytest.mark.thorough
@pytest.mark.parametrize(("platform", "begin_s"), [("hummingbird", 9.0), ("pelican", 11.3)])
@pytest.mark.parametrize("kind", LIES)
def test_an_inertial_unit_that_is_wrong_itself_accuses_nobody(kind: str, platform: str, begin_s: float) -> None:
    assert accused(platform, kind, begin_s, begin_s + 8.0) == (set(), True)


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["scaled", "gyroscopes biased", "accelerometers biased", "struck", "shaken", "late"])
@pytest.mark.parametrize("begin_s", [0.0, 1.0, 2.6])
def test_nor_does_it_at_rest_and_at_take_off(kind: str, begin_s: float) -> None:
    assert accused("pelican", kind, begin_s, 9.0) == (set(), True)


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["scaled", "gyroscopes scaled", "accelerometers biased", "late"])
def test_nor_does_it_in_a_sharp_manoeuvre(kind: str) -> None:
    """There the pose of such a unit may be lost."""
    assert accused("pelican", kind, 5.0, 13.0, speed_m_s=3.0)[0] == set()


def isolation_with(
    moved_m: dict[str, tuple[float, float, float]], blind: frozenset[str] = frozenset()
) -> FaultIsolation:
    """Sources that have moved by so much in the last second, in the eyes of an inertial unit that has felt nothing."""
    motion = InertialMotion(4e-3)
    isolation = FaultIsolation(6.0, 0.01, motion)
    for i in range(65):
        for name, by_m in moved_m.items():
            share = 0.1 if i >= 55 else 0.0
            spread = np.diag((1e-6, 1e-6, 1e4 if name in blind else 1e-6))
            isolation.record(name).add(i * 0.1, tuple(share * value for value in by_m), spread)  # type: ignore[arg-type]
    for i in range(26):
        motion.remember(i * 0.25, np.eye(15) * 1e-6, np.eye(3), (0.0, 0.0, -9.8))
    isolation.update(dict.fromkeys(moved_m, True), (0.0, 0.0, 0.0), 0.0, 6.4)
    return isolation


def test_the_inertial_unit_is_doubted_where_two_that_agree_contradict_it_and_nobody_denies_them() -> None:
    def is_doubted(*args: object) -> bool:
        return isolation_with(*args).witness.is_doubted(6.4)  # type: ignore[arg-type]

    down, still = (0.0, 0.0, 0.3), (0.0, 0.0, 0.0)
    assert is_doubted({"a": down, "b": down})
    assert not is_doubted({"a": down, "b": down, "c": still}), "c has felt nothing either"
    assert is_doubted({"a": down, "b": down, "c": still}, frozenset("c")), "c does not know about down"
    assert not is_doubted({"a": down, "c": still}, frozenset("c")), "one alone is as likely to be wrong"
    assert not is_doubted({"a": down, "b": (0.3, 0.0, 0.0)}), "they do not agree"


def test_a_unit_that_was_doubted_is_no_witness_for_some_time_and_takes_back_what_it_said() -> None:
    witness = isolation_with({"a": (0.0, 0.0, 0.3), "b": (0.0, 0.0, 0.0)}).witness
    assert witness.against == {"a"}
    witness.doubt(6.4)
    assert not witness.against
    assert witness.is_doubted(15.0)
    assert not witness.is_doubted(30.0)
