"""Samplers report what is new, once; the pose processor moves the estimate into the platform's frame."""

import math
from typing import Any

import pytest
from tests.onboard.messages import autopilot_pose, flying, standing
from tests.onboard.stage import Stage

from gloc3.component.deployment import ComponentRow
from gloc3.component.test_bench import Bench
from gloc3.messages.frames import GeoPoint, TangentPlane, Vector3
from gloc3.messages.perception import SatelliteFix
from gloc3.messages.vehicle import AutopilotState, HeightAboveGround, Image, LandedState, Pose
from gloc3_onboard.components.processors.pose import PoseProcessor, PoseSettings
from gloc3_onboard.components.samplers.autopilot_pose import AutopilotPoseSampler
from gloc3_onboard.components.samplers.autopilot_state import AutopilotStateSampler
from gloc3_onboard.components.samplers.camera import CameraSampler
from gloc3_onboard.components.samplers.height import HeightSampler
from gloc3_onboard.sensors.devices import Bell, Stamped, StampedHeight, StampedImage, Unwatch

HOLD = (39.5528, 2.6285, 2.0)


class Device:
    """Everything that can be sampled, as the test sets it."""

    def __init__(self) -> None:
        self.is_open = False
        self.now_state: AutopilotState = standing()
        self.now_pose: Stamped | None = None
        self.now_attitude: Stamped | None = None
        self.now_height: StampedHeight | None = None
        self.now_frame: StampedImage | None = None
        self.bell = Bell()

    def state(self) -> AutopilotState:
        return self.now_state

    def pose(self) -> Stamped | None:
        return self.now_pose

    def attitude(self) -> Stamped | None:
        return self.now_attitude

    def height(self) -> StampedHeight | None:
        return self.now_height

    def frame(self) -> StampedImage | None:
        return self.now_frame

    def open(self) -> None:
        self.is_open = True

    def close(self) -> None:
        self.is_open = False

    def on_state(self, changed: Any) -> Unwatch:
        return self.bell.listen(changed)

    on_pose = on_height = on_new_data = on_state


def hosted(bench: Bench, create: Any) -> Device:
    device = Device()
    bench.host(ComponentRow(name="sampler", class_name="x:Y", rate_hz=50.0), lambda: create(device))
    return device


def test_the_state_is_reported_on_every_change_and_five_times_a_second() -> None:
    with Bench() as bench:
        device = hosted(bench, AutopilotStateSampler)
        bench.run(2.01)
        assert len(bench.all("autopilot")) == pytest.approx(11, abs=1)
        device.now_state = standing(is_armed=True)
        bench.run(0.021)
        assert bench.last("autopilot").is_armed


@pytest.mark.parametrize("kind", ["pose", "height", "image"])
def test_what_is_sampled_is_reported_once_with_its_own_time(kind: str) -> None:
    create = {"pose": AutopilotPoseSampler, "height": HeightSampler, "image": CameraSampler}[kind]
    topic = {"pose": "autopilot_pose"}.get(kind, kind)
    with Bench() as bench:
        device = hosted(bench, create)
        bench.run(0.1)
        assert bench.all(topic) == []
        for t_s in (0.08, 0.08, 0.15, 0.12):
            device.now_pose = Stamped(t_s, autopilot_pose())
            device.now_height = StampedHeight(t_s, HeightAboveGround(height_m=1.0, is_valid=True))
            device.now_frame = StampedImage(t_s, Image(camera="ground", width=1, height=1, data=b"x"))
            bench.run(0.05)
        envelopes = [envelope for envelope in bench.envelopes if envelope.topic == f"bench/{topic}"]
        found = [
            envelope.t_s for envelope in envelopes if "time goes back" not in getattr(envelope.payload, "reason", "")
        ]
        assert found == [0.08, 0.15]


def test_the_attitude_alone_is_reported_while_there_is_no_position() -> None:
    with Bench() as bench:
        device = hosted(bench, AutopilotPoseSampler)
        device.now_pose = Stamped(0.1, autopilot_pose())
        device.now_attitude = Stamped(0.05, autopilot_pose())
        bench.run(0.1)
        assert bench.all("autopilot_attitude") == [], "an older one"
        device.now_attitude = Stamped(0.15, autopilot_pose())
        bench.run(0.1)
        assert bench.all("autopilot_attitude") == [autopilot_pose()]


def test_a_camera_is_open_while_its_sampler_works() -> None:
    with Bench() as bench:
        device = hosted(bench, CameraSampler)
        assert device.is_open
        bench.command("sampler", "stop")
        assert not device.is_open


@pytest.mark.parametrize(
    ("height_m", "is_valid"), [(0.01, False), (0.05, True), (40.0, True), (40.1, False), (math.nan, False)]
)
def test_a_range_beyond_what_the_device_can_tell_is_not_valid(height_m: float, is_valid: bool) -> None:
    with Bench() as bench:
        device = hosted(bench, HeightSampler)
        device.now_height = StampedHeight(0.0, HeightAboveGround(height_m=height_m, is_valid=True))
        bench.run(0.05)
        height = bench.last("height")
        assert height.is_valid == is_valid
        assert bool(height.reason) != is_valid


# --- the pose ---


def processor(origin: tuple[float, float, float] | None = HOLD, **settings: Any) -> Stage:
    return Stage(PoseProcessor(), PoseSettings(origin_geo=origin, **settings))


def poses(stage: Stage, *given: Any) -> list[Pose]:
    for one in given:
        stage.step(autopilot_pose=one)
    return stage.all(Pose)


def test_the_estimate_is_moved_into_the_platforms_frame() -> None:
    stage = processor()
    origin = TangentPlane(GeoPoint(*HOLD)).geo_from_ned((5.0, -3.0, 0.5))
    (found,) = poses(stage, autopilot_pose(1.0, 1.0, 2.0, origin_geo=tuple(origin)))
    assert found.position_ned_m == pytest.approx((6.0, -2.0, -1.5), abs=1e-3)
    assert (found.is_valid, found.origin_geo, found.sources) == (True, HOLD, ["autopilot"])


def test_without_the_autopilots_origin_it_is_not_valid() -> None:
    first, second = poses(processor(), autopilot_pose(), autopilot_pose(origin_geo=HOLD))
    assert (first.is_valid, first.reason, first.quality) == (False, "the autopilot has not sent its origin", 0.0)
    assert second.is_valid


def test_far_from_the_local_frame_or_without_one_the_autopilots_origin_is_taken() -> None:
    elsewhere = (47.4, 8.5, 400.0)
    for origin in (HOLD, None):
        (found,) = poses(processor(origin), autopilot_pose(1.0, origin_geo=elsewhere))
        assert found.position_ned_m == (1.0, 0.0, -2.0)
        assert (found.origin_geo, found.is_valid) == (elsewhere, True)


def test_a_step_that_the_velocity_does_not_explain_is_counted_as_a_jump() -> None:
    stage = processor()
    fast: dict[str, Any] = {"origin_geo": HOLD, "velocity_ned_m_s": (8.0, 0.0, 0.0)}
    found = poses(stage, *[autopilot_pose(0.4 * step, **fast) for step in range(5)])
    assert {pose.reset_counter for pose in found} == {0}
    found = poses(stage, autopilot_pose(9.0, **fast))
    assert found[-1].reset_counter == 1


def test_a_new_origin_of_the_autopilot_is_no_jump() -> None:
    stage = processor()
    moved = TangentPlane(GeoPoint(*HOLD)).geo_from_ned((100.0, 0.0, 0.0))
    found = poses(stage, autopilot_pose(1.0, origin_geo=HOLD), autopilot_pose(-99.0, origin_geo=tuple(moved)))
    assert found[-1].position_ned_m == pytest.approx((1.0, 0.0, -2.0), abs=2e-3)
    assert found[-1].reset_counter == 0


def test_an_estimate_that_is_not_finite_is_not_passed_on_and_counts_as_one_jump() -> None:
    good = autopilot_pose(1.0, origin_geo=HOLD)
    stage = processor()
    found = poses(stage, good, *[autopilot_pose(math.nan, origin_geo=HOLD)] * 3, good)
    assert [pose.is_valid for pose in found] == [True, False, False, False, True]
    assert all(map(math.isfinite, found[2].position_ned_m))
    assert found[2].reason == "the autopilot's estimate is not finite"
    assert found[-1].reset_counter == 1
    (spun,) = poses(processor(), autopilot_pose(1.0, rate_frd_rad_s=(0.0, 0.0, math.nan)))
    assert not spun.is_valid
    (first,) = poses(processor(), autopilot_pose(math.inf))
    assert (first.is_valid, first.position_ned_m) == (False, (0.0, 0.0, 0.0))


def test_a_jump_that_the_velocity_does_not_explain_is_claimed_as_doubt_and_forgotten_in_minutes() -> None:
    stage = processor(std_m=0.05)
    for _ in range(40):
        stage.step(0.05, autopilot_pose=autopilot_pose(origin_geo=HOLD))
    assert stage.all(Pose)[-1].position_std_m[:2] == pytest.approx((0.05, 0.05))
    for _ in range(40):
        stage.step(0.05, autopilot_pose=autopilot_pose(north=5.0, origin_geo=HOLD))
    off = stage.all(Pose)[-1]
    assert math.hypot(*off.position_std_m[:2]) > 4.5
    assert off.quality < 0.6
    for _ in range(6000):
        stage.step(0.05, autopilot_pose=autopilot_pose(north=5.0, origin_geo=HOLD))
    assert math.hypot(*stage.all(Pose)[-1].position_std_m[:2]) < 0.1


def test_a_position_that_drifts_against_its_velocity_is_in_doubt() -> None:
    stage = processor(std_m=0.05)
    for step in range(100):
        stage.step(0.05, autopilot_pose=autopilot_pose(north=0.01 * step, origin_geo=HOLD))
    assert stage.all(Pose)[-1].reset_counter == 0
    assert math.hypot(*stage.all(Pose)[-1].position_std_m[:2]) > 0.9


@pytest.mark.parametrize("away_s", [0.5, 5.0])
def test_what_was_in_doubt_stays_so_after_a_crash(away_s: float) -> None:
    stage = processor(std_m=0.05)
    for step in range(100):
        stage.step(0.05, autopilot_pose=autopilot_pose(north=0.01 * step, origin_geo=HOLD))
    stage.component.initialize(PoseSettings(origin_geo=HOLD, std_m=0.05))
    stage.component.start()
    stage.step(away_s, autopilot_pose=autopilot_pose(north=1.0 + 0.2 * away_s, origin_geo=HOLD))
    drifted_m = math.exp(-away_s / 60.0) + (0.1 if away_s <= 1.0 else 0.0)
    assert math.hypot(*stage.all(Pose)[-1].position_std_m[:2]) == pytest.approx(drifted_m, rel=0.1)


def told(stage: Stage, place_ned_m: tuple[float, float, float], seconds: float, **pose: Any) -> Pose:
    """The last pose at HOLD's origin, beside fixes at that place."""
    place = TangentPlane(GeoPoint(*HOLD)).geo_from_ned(place_ned_m)
    for step in range(round(seconds / 0.1)):
        digits = (place[0], place[1] + 1e-12 * step, place[2])
        fix = SatelliteFix(place_geo=digits, std_m=0.02, height_std_m=0.03, satellites=12)
        stage.step(0.1, satellites=fix, autopilot_pose=autopilot_pose(height=0.0, origin_geo=HOLD, **pose))
    last: Pose = stage.all(Pose)[-1]
    return last


@pytest.mark.parametrize("apart_m", [0.2, 0.4, 1.0, 4.0])
def test_a_receiver_apart_from_the_estimate_at_rest_is_within_two_deviations_in_height_and_over_ground(
    apart_m: float,
) -> None:
    above = told(processor(std_m=0.05), (0.0, 0.0, apart_m), 2.0)
    assert 2.0 * above.position_std_m[2] >= apart_m
    assert above.position_std_m[0] < 0.06
    beside = told(processor(std_m=0.05), (0.0, apart_m, 0.0), 2.0)
    assert 2.0 * math.hypot(*beside.position_std_m[:2]) >= apart_m
    assert beside.position_std_m[2] < 0.06
    assert told(processor(std_m=0.05, is_level=True), (0.0, 0.0, apart_m), 2.0).position_std_m[2] == 0.05


def test_a_height_that_nothing_measures_is_claimed_with_a_growing_deviation() -> None:
    stage = processor(std_m=0.05)
    assert told(stage, (0.0, 0.0, 0.0), 1.0).position_std_m[2] < 0.06
    assert told(stage, (0.0, 0.0, 0.0), 3.0, has_height=False).position_std_m[2] > 1.0
    assert told(stage, (0.0, 0.0, 0.0), 0.2).position_std_m[2] < 0.06


def frozen(
    landed: LandedState,
    velocity_ned_m_s: Vector3 = (0.0, 0.0, 0.0),
    *,
    seconds: float = 2.0,
    is_level: bool = False,
    is_alive: bool = False,
) -> Pose:
    """The pose after the receiver has said the same for a time, ten times a second; `is_alive`: but for its speed."""
    stage = processor(std_m=0.05, is_level=is_level)
    for step in range(round(seconds / 0.1)):
        speed_m_s = 0.01 * (step % 3) if is_alive else 0.0
        fix = SatelliteFix(place_geo=HOLD, std_m=0.02, height_std_m=0.03, satellites=12, speed_m_s=speed_m_s)
        given = autopilot_pose(height=0.0, velocity_ned_m_s=velocity_ned_m_s, origin_geo=HOLD)
        stage.step(0.1, autopilot=flying(landed=landed), satellites=fix, autopilot_pose=given)
    last: Pose = stage.all(Pose)[-1]
    return last


OFF_THE_GROUND: list[tuple[LandedState, Vector3]] = [
    (LandedState.TAKING_OFF, (0.0, 0.0, -0.3)),
    (LandedState.IN_AIR, (0.0, 0.0, 0.0)),
    (LandedState.LANDING, (0.0, 0.0, 0.3)),
]


@pytest.mark.parametrize(("landed", "slowly"), OFF_THE_GROUND)
def test_a_receiver_that_repeats_itself_is_doubted_off_the_ground_the_more_the_faster(
    landed: LandedState, slowly: Vector3
) -> None:
    assert 0.4 < frozen(landed, slowly).position_std_m[0] < 0.7
    assert frozen(landed, (0.0, 0.0, -1.5)).position_std_m[2] > 2.5
    assert frozen(landed, (3.0, 0.0, 0.0)).position_std_m[0] > 3.5
    assert frozen(LandedState.ON_GROUND).position_std_m == pytest.approx((0.05, 0.05, 0.05))


@pytest.mark.parametrize(("landed", "slowly"), OFF_THE_GROUND)
def test_a_receiver_that_repeats_itself_off_the_ground_invalidates_the_pose_at_once(
    landed: LandedState, slowly: Vector3
) -> None:
    assert frozen(landed, slowly, seconds=0.2).is_valid
    lost = frozen(landed, slowly, seconds=0.5)
    assert not lost.is_valid
    assert "repeating one position" in lost.reason
    assert frozen(LandedState.ON_GROUND).is_valid


@pytest.mark.parametrize("landed", [LandedState.IN_AIR, LandedState.LANDING])
@pytest.mark.parametrize("silent_s", [0.5, 5.0])
def test_after_a_silence_of_the_autopilot_in_flight_the_second_position_of_the_receiver_is_awaited(
    silent_s: float, landed: LandedState
) -> None:
    stage = processor(std_m=0.05)

    def step(place: int, after_s: float = 0.1, landed: LandedState = landed) -> Pose:
        fix = SatelliteFix(place_geo=(HOLD[0], HOLD[1] + 1e-9 * place, HOLD[2]), satellites=12)
        given = autopilot_pose(height=0.0, origin_geo=HOLD)
        stage.step(after_s, autopilot=flying(landed=landed), satellites=fix, autopilot_pose=given)
        last: Pose = stage.all(Pose)[-1]
        return last

    assert step(0).is_valid
    again = step(1, silent_s)
    assert again.is_valid == (silent_s < 3.0)
    assert ("second position" in again.reason) == (silent_s > 3.0)
    assert step(1).is_valid == again.is_valid
    assert step(2).is_valid
    step(3, 5.0)
    assert not step(3, 5.0).is_valid
    assert step(3, landed=LandedState.ON_GROUND).is_valid


def test_a_position_that_repeats_by_chance_in_a_hover_is_believed_for_a_second() -> None:
    assert frozen(LandedState.IN_AIR, seconds=0.9, is_alive=True).is_valid
    lost = frozen(LandedState.IN_AIR, seconds=1.5, is_alive=True)
    assert not lost.is_valid
    assert "repeating one position" in lost.reason


@pytest.mark.parametrize("landed", [LandedState.TAKING_OFF, LandedState.LANDING])
def test_a_vehicle_that_stands_on_the_ground_before_its_autopilot_says_so_has_a_pose(landed: LandedState) -> None:
    assert frozen(landed, (0.02, -0.02, 0.01)).is_valid


def test_a_boat_that_rests_has_a_pose_and_one_that_moves_is_not_led_by_a_frozen_receiver() -> None:
    assert frozen(LandedState.IN_AIR, (0.02, -0.02, 0.0), is_level=True).is_valid
    assert not frozen(LandedState.IN_AIR, (0.5, 0.0, 0.0), is_level=True).is_valid
