"""Every source removed, frozen, biased, late or garbage in flight: the pose stays right, or says that it does not know."""

from itertools import combinations

import msgspec
import numpy as np
import pytest

from gloc3.messages.frames import conjugate, multiply, to_rotation_vector
from gloc3.messages.vehicle import HeightAboveGround
from gloc3_onboard.algorithms.fusion.fault_isolation import IsolationResult
from gloc3_onboard.algorithms.fusion.pose_fusion import PoseFusion
from gloc3_onboard.algorithms.fusion.settings import FusionSettings

from .ablation import FAULTS, HARMLESS, SOURCES, judge, suffer
from .flown import GRAVITY, Flight, Height, Odometer, Sensor, Tracker, inspection, sensors_of
from .fly import Flown, Recorder, attitude_of, fly

pytestmark = pytest.mark.thorough

MID_FLIGHT = {"fault_s": (9.0, 15.0), "until_s": 20.0}
NOT_FOUND = {("height", "frozen"), ("height", "old"), ("height", "scale")}
"""At a constant height of 1.5 m these say nothing that is wrong by more than a floor may rise."""
HALF = [
    (name, fault)
    for row, name in enumerate(SOURCES["hummingbird"])
    for column, fault in enumerate(FAULTS)
    if (row + column) % 2 == 0
]
"""Each source with every other fault, each fault with every other source; `make evidence NAME=fusion-ablation` flies all."""


@pytest.mark.parametrize(("name", "fault"), HALF)
def test_any_fault_of_one_source_is_survived_without_a_laser(name: str, fault: str) -> None:
    found = suffer("hummingbird", (name,), fault, **MID_FLIGHT)  # type: ignore[arg-type]
    assert found.worst_m < 0.15
    assert found.valid_share == 1.0
    assert found.wrong_s == 0.0
    if fault not in HARMLESS and (name, fault) not in NOT_FOUND:
        assert found.detected_s is not None
        assert found.detected_s < (5.0 if fault == "scale" else 0.8)


@pytest.mark.parametrize("names", list(combinations(SOURCES["hummingbird"], 2)))
def test_with_any_two_of_its_sources_gone_the_pose_is_good_and_says_that_it_rests_on_less(
    names: tuple[str, ...],
) -> None:
    found = suffer("hummingbird", names, "removed", **MID_FLIGHT)  # type: ignore[arg-type]
    assert found.worst_m < 0.1
    assert found.valid_share == 1.0
    assert found.is_let_in
    is_lone = "tracker" in names and "height" not in names  # an odometer, whose error of scale is claimed for its way
    assert found.least_quality == pytest.approx(0.8 if "height" in names else 0.5, abs=0.03 if is_lone else 0.02)


@pytest.mark.parametrize("fault", ["frozen", "scale", "old"])
def test_with_a_laser_more_is_known(fault: str) -> None:
    found = suffer("pelican", ("stereo",), fault, **MID_FLIGHT)  # type: ignore[arg-type]
    assert found.worst_m < 0.03
    assert found.detected_s is not None
    assert found.detected_s < 3.5


def test_two_that_contradict_each_other_with_nobody_to_tell_end_in_a_pose_that_is_not_valid_and_says_who() -> None:
    sensors = [sensor for sensor in sensors_of("hummingbird", 0) if sensor.name != "tracker"]
    sensors[0].fault, sensors[0].fault_s = "scale", (9.0, 60.0)
    flown = fly(inspection(), sensors, until_s=30.0)
    found = judge(flown, ("stereo",), (9.0, 60.0))
    assert found.wrong_s == 0.0
    assert "ground" in found.reason
    assert "stereo" in found.reason
    slow = [pose.quality for pose in flown.poses]
    assert min(slow) == 0.0
    assert any(0.2 < quality <= 0.5 for quality in slow)


def test_who_is_dragged_along_by_one_that_is_wrong_still_has_its_vote_against_it() -> None:
    found = suffer("hummingbird", ("stereo",), "scale", fault_s=(30.0, 60.0), until_s=50.0)
    assert found.valid_share == 1.0
    assert found.worst_m < 0.15
    assert found.detected_s is not None
    assert found.detected_s < 5.0


def test_where_two_stumble_at_once_the_heading_is_not_lost_with_them() -> None:
    sensors = [sensor for sensor in sensors_of("pelican", 0) if sensor.name != "tracker"]
    for sensor in sensors:
        if sensor.name in ("stereo", "ground"):
            sensor.fault, sensor.fault_s = "garbage", (9.0, 9.5)
    flown = fly(inspection(), sensors, until_s=30.0)
    assert np.degrees(np.abs(flown.turn_rad[:, 2])).max() < 0.5
    assert flown.worst_m() < 0.1


@pytest.mark.parametrize("kind", ["frozen", "garbage", "bias"])
def test_an_inertial_unit_that_lies_is_found_out(kind: str) -> None:
    held = ((0.0, 0.0, 0.0), (0.0, 0.0, -9.8))
    rng = np.random.default_rng(1)

    def lying(t_s: float, rate: tuple[float, ...], force: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
        if not 9.0 <= t_s < 14.0:
            return rate, force
        match kind:
            case "frozen":
                return held
            case "garbage":
                return tuple((rng.normal(size=3) * 100.0).tolist()), force
        return (rate[0], rate[1], rate[2] + 0.05), force

    flown = fly(inspection(), sensors_of("hummingbird", 0), imu=lying, until_s=20.0)  # type: ignore[arg-type]
    assert all(pose.is_valid for pose in flown.poses)
    assert flown.worst_m() < 0.3
    assert flown.worst_m(18.0) < 0.06


@pytest.mark.parametrize("kind", ["turns", "scale"])
def test_an_inertial_unit_that_turns_is_found_by_the_autopilot_and_what_a_scaled_one_does_by_the_others(
    kind: str,
) -> None:
    def lying(t_s: float, rate: tuple[float, ...], force: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
        if t_s < 9.0:
            return rate, force
        if kind == "turns":
            return (rate[0] + 0.5, rate[1], rate[2]), force
        return tuple(1.05 * value for value in rate), tuple(1.05 * value for value in force)

    until_s = 12.0 if kind == "turns" else 40.0
    flown = fly(inspection(), sensors_of("hummingbird", 0), imu=lying, until_s=until_s, has_autopilot=True)  # type: ignore[arg-type]
    assert all(pose.is_valid for pose in flown.poses)
    assert flown.worst_m() < 0.15
    found = [t_s for t_s, pose in zip(flown.t_s, flown.poses, strict=True) if "imu" not in pose.sources]
    assert kind == "scale" or 9.0 < found[0] < 9.5


def scaled(t_s: float, rate: tuple[float, ...], force: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
    """The inertial unit's accelerometers are 5 % too long from 12 s on."""
    return rate, tuple(1.05 * value for value in force) if t_s >= 12.0 else force


@pytest.mark.parametrize("platform", ["pelican", "hummingbird"])
@pytest.mark.parametrize("faults", [{"stereo": "late"}, {"stereo": "late", "tracker": "removed"}])
def test_odometers_that_see_no_height_do_not_keep_a_wrong_one(platform: str, faults: dict[str, str]) -> None:
    """The inertial unit's error lets the pose rise by metres while the laser, which sees no height, agrees with it."""

    sensors = sensors_of(platform, 0)
    for sensor in sensors:
        if sensor.name in faults:
            sensor.fault, sensor.fault_s = faults[sensor.name], (12.0, 60.0)
    flown = fly(inspection(), sensors, imu=scaled, until_s=20.0, has_autopilot=True)  # type: ignore[arg-type]
    assert flown.worst_m() < 0.3
    assert flown.worst_m(18.0) < 0.15


def left_alone(name: str, fault: str = "") -> list[Sensor]:
    """From 12 s on there is one odometer and the height, and the odometer may have a fault."""
    sensors = sensors_of("hummingbird", 0)
    for sensor in sensors:
        if sensor.name not in (name, "height"):
            sensor.fault, sensor.fault_s = "removed", (12.0, 60.0)
        elif sensor.name == name and fault:
            sensor.fault, sensor.fault_s = fault, (12.0, 60.0)
    return sensors


def longest_dishonest_s(flown: Flown) -> float:
    """For how long a valid pose was off by more than four of its standard deviations along any axis."""
    claimed = np.maximum(np.array([pose.position_std_m for pose in flown.poses]), 0.01)
    valid = np.array([pose.is_valid for pose in flown.poses])
    is_wrong = valid & (np.abs(flown.error_m) > 4.0 * claimed).any(axis=1)
    longest_s, since_s = 0.0, None
    for t_s, wrong in zip(flown.t_s.tolist(), is_wrong.tolist(), strict=True):
        since_s = (t_s if since_s is None else since_s) if wrong else None
        longest_s = max(longest_s, t_s - since_s) if since_s is not None else longest_s
    return longest_s


def test_an_odometer_that_is_left_alone_claims_an_error_of_scale() -> None:
    flown = fly(inspection(), left_alone("stereo", "scale"), until_s=24.0)
    assert all(pose.is_valid for pose in flown.poses)
    assert flown.worst_m(23.0) > 0.3, "5 % too long, and nobody there to see it"
    assert longest_dishonest_s(flown) < 0.3


@pytest.mark.parametrize("by_m_s2", [0.1, 0.2, 0.4])
def test_what_the_only_odometer_has_told_while_nothing_held_the_position_is_doubted(by_m_s2: float) -> None:
    """The pose follows accelerometers that are wrong, and the odometer that is right does not pass the gate for a second."""

    def lying(t_s: float, rate: tuple[float, ...], force: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
        return rate, tuple(value + (by_m_s2 if t_s >= 12.0 else 0.0) for value in force)

    flown = fly(inspection(), left_alone("stereo"), imu=lying, until_s=20.0)  # type: ignore[arg-type]
    assert flown.worst_m() > 0.3
    assert longest_dishonest_s(flown) < 0.6


STIFF = FusionSettings(start_ned_m=(0.0, 0.0, 0.0), start_heading_deg=0.0, height_std_m=0.01, floor_walk=0.002)
"""As over the deck of a ship."""


def level_sensors(platform: str) -> list[Sensor]:
    """Without stereo camera and tracker; the odometers that are left see no height."""
    sensors = [sensor for sensor in sensors_of(platform, 0) if sensor.name in ("laser", "ground", "height")]
    for sensor in sensors:
        if isinstance(sensor, Odometer):
            sensor.blind = (2, 3, 4)
    return sensors


@pytest.mark.parametrize("platform", ["pelican", "hummingbird"])
def test_a_floor_that_moves_away_is_none_but_an_estimate_that_falls(platform: str) -> None:
    """Nothing but the range to the floor measures the height, and the inertial unit is wrong: metres in seconds."""

    flown = fly(inspection(), level_sensors(platform), 0, STIFF, imu=scaled, until_s=20.0)  # type: ignore[arg-type]
    assert flown.poses[-1].is_valid
    assert flown.worst_m() < 0.3
    assert flown.worst_m(14.0) < 0.1


def test_a_range_to_the_floor_that_stays_the_same_over_two_metres_is_frozen() -> None:
    """While it is believed, the pose keeps its height, and a vehicle with wrong accelerometers climbs away."""
    sensors = sensors_of("hummingbird", 0)
    sensors[-1].fault, sensors[-1].fault_s = "frozen", (12.0, 16.0)
    flown = fly(inspection(), sensors, until_s=20.0)
    without = [t_s for t_s, pose in zip(flown.t_s, flown.poses, strict=True) if "height" not in pose.sources]
    assert 13.0 < without[0] < 16.0
    assert without[-1] < 18.0
    assert flown.worst_m() < 0.06


@pytest.mark.parametrize("fault", ["garbage", "frozen"])
def test_a_range_finder_that_is_broken_does_not_shake_an_estimate_that_nothing_else_contradicts(fault: str) -> None:
    sensors = level_sensors("pelican")
    sensors[-1].fault, sensors[-1].fault_s = fault, (3.0, 60.0)  # while it climbs
    flown = fly(inspection(), sensors, 0, STIFF, until_s=10.0)
    assert all("imu" in pose.sources for pose in flown.poses)
    assert flown.worst_m() < 0.1


def test_a_box_below_is_another_floor_also_where_nothing_else_measures_the_height() -> None:
    sensors = level_sensors("pelican")
    height = next(sensor for sensor in sensors if isinstance(sensor, Height))
    height.boxes_s = ((10.0, 14.0), (17.0, 20.0))
    flown = fly(inspection(), sensors, 0, STIFF, until_s=24.0)
    assert all(pose.is_valid for pose in flown.poses)
    assert flown.worst_m() < 0.06
    assert max(max(pose.position_std_m) for pose in flown.poses) < 0.1


def faulty(platform: str, faults: dict[str, str]) -> list[Sensor]:
    """The sensors of a platform, some with a fault from 12 s on."""
    sensors = sensors_of(platform, 0)
    for sensor in sensors:
        if sensor.name in faults:
            sensor.fault, sensor.fault_s = faults[sensor.name], (12.0, 60.0)
    return sensors


def test_samples_of_the_inertial_unit_that_are_stamped_as_new_are_found_by_the_autopilots_turns() -> None:
    before = dict[float, tuple[tuple[float, ...], ...]]()

    def old(t_s: float, rate: tuple[float, ...], force: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
        before[round(t_s, 2)] = (rate, force)
        return before[round(t_s - 0.2, 2)] if t_s >= 12.0 else (rate, force)

    flown = fly(inspection(), sensors_of("hummingbird", 0), imu=old, until_s=24.0, has_autopilot=True)  # type: ignore[arg-type]
    off = [t_s for t_s, pose in zip(flown.t_s, flown.poses, strict=True) if "imu" not in pose.sources]
    assert 12.0 < off[0] < 13.0
    assert flown.worst_m() < 0.1
    assert longest_dishonest_s(flown) < 0.3


def test_late_samples_of_the_inertial_unit_leave_the_attitude_to_the_autopilot() -> None:
    calls = Recorder.of(inspection(), sensors_of("hummingbird", 0), until_s=20.0)
    fusion, waiting = PoseFusion(Recorder.SETTINGS), list[tuple[object, ...]]()
    flight = inspection()
    for name, given in calls:
        if name == "imu" and given[2] >= 12.0:
            waiting.append(given)
            continue
        now_s = given[0] if name == "tick" else 0.0
        while waiting and waiting[0][2] <= now_s - 0.2:  # type: ignore[operator]
            fusion.imu(*waiting.pop(0))  # type: ignore[arg-type]
        if name == "tick" and now_s > 0.5:
            fusion.attitude(attitude_of(flight, flight.index(now_s)), now_s)
        getattr(fusion, name)(*given)
    pose = fusion.pose()
    assert "autopilot" in pose.sources
    assert "imu" not in pose.sources
    true = flight.attitude[flight.index(fusion.estimate.t_s)]
    turn_rad = to_rotation_vector(multiply(true, conjugate(pose.ned_from_frd)))
    assert np.degrees(np.abs(turn_rad)).max() < 2.0


def test_heights_that_lead_away_are_doubted_at_once_where_nothing_else_holds_the_height() -> None:
    sensors = faulty("pelican", {"stereo": "removed", "tracker": "removed"})
    flown = fly(inspection(), sensors, 0, STIFF, imu=scaled, until_s=20.0)  # type: ignore[arg-type]
    assert np.abs(flown.error_m[:, 2]).max() > 0.1
    assert longest_dishonest_s(flown) < 0.3
    assert flown.fusion.estimate.sunk_m == 0.0, "it is found again"


@pytest.mark.parametrize("seed", [0, 1])
def test_late_heights_make_no_new_floor_while_the_vehicle_climbs(seed: int) -> None:
    sensors = sensors_of("hummingbird", seed)
    for sensor in sensors:
        if sensor.name in ("stereo", "tracker", "height"):
            sensor.fault, sensor.fault_s = "old" if sensor.name == "height" else "removed", (2.0, 60.0)
    flown = fly(inspection(), sensors, seed, STIFF, until_s=8.0)
    assert np.abs(flown.error_m[:, 2]).max() < 0.05


def test_an_odometer_that_stumbles_does_not_make_heights_right_that_have_stepped_long_before() -> None:
    sensors = faulty("hummingbird", {"height": "step", "stereo": "garbage", "tracker": "removed"})
    for sensor in sensors:
        if sensor.name == "stereo":
            sensor.fault_s = (13.2, 13.5)
        elif isinstance(sensor, Odometer):
            sensor.blind = (2, 3, 4)
    flown = fly(inspection(), sensors, 0, STIFF, until_s=20.0)
    assert np.abs(flown.error_m[:, 2]).max() < 0.06


def test_heights_that_come_back_leave_in_doubt_what_they_have_moved() -> None:
    """Nothing else knows how far off the position was meanwhile, and the heights may be as wrong as they were."""
    fusion = PoseFusion(msgspec.structs.replace(STIFF, probation_s=0.3))
    for name, given in Recorder.of(inspection(), faulty("hummingbird", {"height": "step"}), until_s=12.6):
        getattr(fusion, name)(*given)
    assert "height" not in fusion.pose().sources
    flight = inspection()
    fusion.estimate.inflate_position((0.3, 0.0, 0.1))  # together, as along the line of sight of a tracker
    for count in range(1260, 1400):
        t_s = count / 100
        index = flight.index(t_s)
        fusion.imu(tuple(flight.rate[index].tolist()), tuple(flight.force[index].tolist()), t_s)
        if count % 10 == 0:
            height_m = 0.3 - float(flight.position[index][2])
            fusion.height(HeightAboveGround(height_m=height_m, is_valid=True), t_s)
            fusion.tick(t_s)
    pose = fusion.pose()
    assert "height" in pose.sources
    off_m = abs(pose.position_ned_m[2] - float(flight.position[flight.index(fusion.estimate.t_s)][2]))
    assert off_m > 0.1
    assert off_m < 4.0 * pose.position_std_m[2]


class SteeredHeight(Height):
    """Frozen on a vehicle that is steered by an estimate which `scaled` carries up: to the truth, heights that lead away."""

    def measure(self, flight: Flight, t_s: float) -> HeightAboveGround:
        reported: HeightAboveGround = super().measure(flight, t_s)
        risen_m = 0.5 * 0.05 * GRAVITY * max(t_s - 12.0, 0.0) ** 2
        return msgspec.structs.replace(reported, height_m=reported.height_m + risen_m)


def test_an_inertial_unit_that_carries_the_pose_away_beside_a_frozen_height_is_told_of_at_once() -> None:
    """The stereo camera alone sees it, and looks plainly wrong itself; the heights seem to confirm what is not so."""
    sensors = faulty("hummingbird", {"tracker": "removed"})
    sensors[-1] = SteeredHeight("height", 20.0, 0.02, rng=np.random.default_rng(3))
    for sensor in sensors:
        if sensor.name == "ground" and isinstance(sensor, Odometer):
            sensor.blind = (2, 3, 4)
    flown = fly(inspection(), sensors, 0, STIFF, imu=scaled, until_s=13.5)  # type: ignore[arg-type]
    assert np.abs(flown.error_m[:, 2]).max() > 0.1
    assert longest_dishonest_s(flown) < 0.3


def test_a_height_that_repeats_itself_does_not_hold_a_height_that_is_uncertain() -> None:
    fusion = PoseFusion(STIFF)
    for name, given in Recorder.of(inspection(), sensors_of("hummingbird", 0), until_s=12.0):
        getattr(fusion, name)(*given)
    flight, height_m = inspection(), 0.1 - fusion.pose().position_ned_m[2]
    told_m = []
    for count in range(10):
        t_s = 12.1 + 0.1 * count
        if count == 6:
            fusion.estimate.inflate_position((0.0, 0.0, 0.3))
        index = flight.index(t_s)
        fusion.imu(tuple(flight.rate[index].tolist()), tuple(flight.force[index].tolist()), t_s)
        fusion.height(HeightAboveGround(height_m=height_m + (0.01 if count == 9 else 0.0), is_valid=True), t_s)
        told_m.append(fusion.pose().position_std_m[2])
    assert min(told_m[6:9]) > 0.29
    assert told_m[9] < 0.1, "the next one that is another is believed"


def test_the_error_of_scale_of_the_only_odometer_is_told_where_the_tracker_looks_along_the_way() -> None:
    sensors = faulty("hummingbird", {"ground": "removed", "stereo": "scale"})
    tracker = next(sensor for sensor in sensors if isinstance(sensor, Tracker))
    tracker.std_m = (0.5, 0.01, 0.01)
    flown = fly(inspection(), sensors, until_s=24.0)
    assert np.abs(flown.error_m[:, 0]).max() > 0.1
    assert longest_dishonest_s(flown) < 0.3
    tracker.std_m = (0.01, 0.01, 0.01)
    seen = fly(inspection(), faulty("hummingbird", {"ground": "removed"}), until_s=24.0)
    assert max(seen.poses[-1].position_std_m) < 0.03, "across its line of sight the tracker shows it"


@pytest.mark.parametrize(
    ("removed", "reason"), [("", ""), ("tracker", "ground and stereo have contradicted each other")]
)
def test_two_that_contradict_each_other_do_not_end_a_pose_that_a_tracker_holds(removed: str, reason: str) -> None:
    """How far they are apart is told all the time; without the tracker the doubt grows with nobody to end it."""

    class Doubting(PoseFusion):
        def tick(self, now_s: float) -> None:
            super().tick(now_s)
            voting = self._voting
            if now_s > 12.0:
                voting.conflict = IsolationResult("", ("ground", "stereo"), (0.01, 0.0, 0.0))
                voting.conflict_s = 12.0

    sensors = [sensor for sensor in sensors_of("hummingbird", 0) if sensor.name != removed]
    flown = fly(inspection(), sensors, until_s=21.0, fusion=Doubting(Recorder.SETTINGS))
    assert flown.fusion.why_not_valid().startswith(reason)
    assert flown.poses[-1].is_valid == (not reason)
    assert flown.poses[-1].quality == pytest.approx(0.0 if reason else 0.5, abs=0.01)


@pytest.mark.parametrize("is_by_two", [True, False])
def test_a_dispute_that_two_others_have_decided_ends_once_nothing_has_contradicted_them_for_a_window(
    *, is_by_two: bool
) -> None:
    """The loser need not agree again: that takes a way, and a pose in doubt lets the vehicle go none."""

    class Doubting(PoseFusion):
        is_decided = False

        def tick(self, now_s: float) -> None:
            super().tick(now_s)
            if now_s > 12.0 and not self.is_decided:
                self.is_decided, voting = True, self._voting
                voting._contradicted, voting._contradicted_s = ("ground", "stereo"), now_s
                voting.conflict_s = now_s
                self.estimate.disputed_m = (0.3, 0.0, 0.0)
                voting.trust["stereo"].turn_down("voted out", is_voted_out=True)
                if not is_by_two:
                    voting._unconfirmed.add("stereo")
            if self.is_decided:
                self._voting.trust["stereo"].is_voted_out = True

    flown = fly(
        inspection(), faulty("hummingbird", {"stereo": "scale"}), until_s=20.0, fusion=Doubting(Recorder.SETTINGS)
    )
    last = next(pose for pose, t_s in zip(flown.poses, flown.t_s, strict=True) if t_s > 17.5)
    assert max(last.position_std_m) > 0.3
    assert "stereo" not in flown.poses[-1].sources
    assert (max(flown.poses[-1].position_std_m) < 0.1) == is_by_two


@pytest.mark.parametrize(("innovation", "factor"), [(1.0, 1.0), (6.0, 2.0)])
def test_a_pose_that_its_own_sources_contradict_is_as_uncertain_as_they_say(innovation: float, factor: float) -> None:
    """A mean of 1.5 would still be sound."""
    fusion, flight = PoseFusion(Recorder.SETTINGS), inspection()
    for name, given in Recorder.of(flight, sensors_of("hummingbird", 0), until_s=12.0):
        getattr(fusion, name)(*given)
    for trust in fusion._voting.trust.values():
        trust.innovation = innovation
    for index in range(1201, 1231):
        fusion.imu(tuple(flight.rate[index].tolist()), tuple(flight.force[index].tolist()), index / 100.0)
    fusion.tick(12.3)
    covariance_m2 = fusion.estimate.errors.covariance.diagonal()[:3]
    assert np.array(fusion.pose().position_std_m) / np.sqrt(covariance_m2) == pytest.approx(factor, abs=0.05)
