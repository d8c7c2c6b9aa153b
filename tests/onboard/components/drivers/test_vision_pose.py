"""The pose on its way to the autopilot: which are sent and how often, the origin, and the message itself."""

import pytest
from tests.onboard.autopilot.test_autopilot_link import Rig
from tests.onboard.messages import autopilot_pose, pose, standing
from tests.onboard.stage import Stage

from gloc3.messages.frames import from_yaw
from gloc3.messages.vehicle import Pose
from gloc3_onboard.components.drivers.vision_pose import VisionPoseDriver, VisionPoseSettings
from gloc3_onboard.sensors.devices import CommandAnswer

ORIGIN = (39.5528, 2.6285, 2.0)


class Device:
    """Remembers what it is told."""

    def __init__(self) -> None:
        self.poses: list[tuple[Pose, float]] = []
        self.origins: list[tuple[float, float, float]] = []
        self.homes: list[tuple[float, float, float]] = []
        self.sets: list[int] = []
        self.answers: dict[int, CommandAnswer] = {}
        self.contacts = 1

    def send_pose(self, pose: Pose, t_s: float, attitude_std_rad: float, velocity_std_m_s: float) -> None:
        self.poses.append((pose, t_s))

    def send_origin(self, origin_geo: tuple[float, float, float]) -> None:
        self.origins.append(origin_geo)

    def command_home(self, place_geo: tuple[float, float, float]) -> int:
        self.homes.append(place_geo)
        return 1

    def command_source_set(self, number: int) -> int:
        self.sets.append(number)
        return 2

    def answer(self, ticket: int) -> CommandAnswer | None:
        return self.answers.get(ticket)


def test_each_valid_pose_is_sent_once_and_no_more_often_than_the_rate() -> None:
    device = Device()
    driver = VisionPoseDriver(device)
    stage = Stage(driver, VisionPoseSettings(rate_hz=25.0))
    for _ in range(100):
        stage.step(0.01, pose=pose())
    assert len(device.poses) == pytest.approx(25, abs=1)
    stage.step(0.05)
    stage.put(stage.now_s - 1.0, pose=pose())
    stage.cycle()
    assert len(device.poses) == pytest.approx(25, abs=1)
    assert driver.reason == "its time does not advance"


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (pose(is_valid=False, reason="uncertain by 0.50 m"), "uncertain by 0.50 m"),
        (pose(quality=0.05), "its quality is only 0.05"),
    ],
)
def test_what_cannot_be_flown_by_is_withheld(bad: Pose, reason: str) -> None:
    device = Device()
    driver = VisionPoseDriver(device)
    stage = Stage(driver, VisionPoseSettings(least_quality=0.1))
    stage.step(0.05, pose=bad)
    assert (device.poses, driver.withheld, driver.reason) == ([], 1, reason)
    stage.step(0.05, pose=pose())
    assert len(device.poses) == 1
    assert driver.reason == ""


def test_a_quiet_one_sends_nothing() -> None:
    device = Device()
    stage = Stage(VisionPoseDriver(device))
    stage.is_quiet = True
    stage.step(0.05, pose=pose())
    assert device.poses == []


def test_the_origin_is_told_until_the_autopilot_has_it() -> None:
    device = Device()
    stage = Stage(VisionPoseDriver(device))
    placed = pose(origin_geo=ORIGIN)
    stage.step(0.05, pose=placed)
    assert device.origins == []  # nobody is heard yet
    for _ in range(45):
        stage.step(0.05, pose=placed, autopilot_pose=autopilot_pose())
    assert device.origins == [ORIGIN] * 3
    for _ in range(45):
        stage.step(0.05, pose=placed, autopilot_pose=autopilot_pose(origin_geo=ORIGIN))
    assert len(device.origins) == 3


@pytest.mark.parametrize("style", ["px4", "ardupilot"])
def test_the_message_is_in_the_frame_that_the_style_believes(style: str) -> None:
    with Rig(style) as rig:
        rig.run(4.0)
        reported = pose(
            1.0,
            2.0,
            3.0,
            velocity_ned_m_s=(0.5, 0.0, 0.1),
            ned_from_frd=from_yaw(1.5707963267948966),
            position_std_m=(0.01, 0.02, 0.03),
            quality=0.8,
            reset_counter=258,
        )
        rig.device.send_pose(reported, rig.loop.time() - 0.06, 0.02, 0.1)
        rig.device.send_origin(ORIGIN)
        rig.run(0.1)
        received = {message.name: message for message in rig.autopilot.received}
        message = received["ODOMETRY"]
        frame = 1 if style == "px4" else 20  # LOCAL_NED, LOCAL_FRD
        assert (message.frame_id, message.child_frame_id, message.estimator_type) == (frame, 12, 3)
        assert (message.x, message.y, message.z) == (1.0, 2.0, -3.0)
        assert (message.vx, message.vy, message.vz) == pytest.approx((0.0, -0.5, 0.1), abs=1e-6)
        assert [message.pose_covariance[i] for i in (0, 6, 11, 15)] == pytest.approx([1e-4, 4e-4, 9e-4, 4e-4])
        assert (message.reset_counter, message.quality) == (2, 80)
        assert message.time_usec * 1e-6 == pytest.approx(4.0 - 0.06, abs=0.03)
        assert received["SET_GPS_GLOBAL_ORIGIN"].latitude == 395528000


def test_home_is_told_where_an_autopilot_with_our_origin_has_none_for_long() -> None:
    device = Device()
    stage = Stage(VisionPoseDriver(device))
    placed = pose(north=100.0, height=0.0, origin_geo=ORIGIN)
    stage.put(autopilot=standing())
    for _ in range(100):
        stage.step(0.1, pose=placed, autopilot_pose=autopilot_pose(origin_geo=ORIGIN))
    (home,) = device.homes
    assert home[0] == pytest.approx(ORIGIN[0] + 100.0 / 111_040.0, abs=1e-5)
    assert home[2] == pytest.approx(ORIGIN[2], abs=0.01)
    for reported in (standing(has_home=True), standing(is_armed=True)):
        for _ in range(100):
            stage.step(0.1, pose=placed, autopilot_pose=autopilot_pose(origin_geo=ORIGIN), autopilot=reported)
        assert len(device.homes) == 1


def test_the_set_of_sources_follows_what_is_sent() -> None:
    device = Device()
    driver = VisionPoseDriver(device)
    stage = Stage(driver, VisionPoseSettings(source_set=2, other_source_set=1))
    for _ in range(10):
        stage.step(0.05, pose=pose())
    assert device.sets == [], "half a second of poses is no reason to rely on them"
    for _ in range(20):
        stage.step(0.05, pose=pose())
    assert device.sets == [2]
    device.answers[2] = CommandAnswer(False, "not supported")
    for _ in range(40):
        stage.step(0.05, pose=pose(is_valid=False, reason="lost"))
    assert device.sets == [2, 1]
    assert driver.refusal == "not supported"
    for _ in range(40):
        stage.step(0.05, pose=pose())
    assert device.sets == [2, 1, 2]


def test_the_set_of_sources_is_changed_when_poses_stop_to_come_and_when_none_comes_after_a_restart() -> None:
    device = Device()
    stage = Stage(VisionPoseDriver(device), VisionPoseSettings(source_set=2, other_source_set=1))
    for _ in range(30):
        stage.step(0.05, pose=pose())
    stage.step(1.1)
    stage.step(0.2)
    assert device.sets == [2, 1]
    restarted = Device()
    fresh = Stage(VisionPoseDriver(restarted), VisionPoseSettings(source_set=2, other_source_set=1))
    for _ in range(10):
        fresh.step(0.2)
    assert restarted.sets == [], "an autopilot on deck chooses for itself"
    for _ in range(10):
        fresh.step(0.2, autopilot=standing(is_armed=True))
    assert restarted.sets == [1]


@pytest.mark.parametrize("answer", [CommandAnswer(False, "temporarily rejected"), None])
def test_a_set_of_sources_that_is_refused_or_not_answered_is_requested_again_every_few_seconds(
    answer: CommandAnswer | None,
) -> None:
    device = Device()
    stage = Stage(VisionPoseDriver(device), VisionPoseSettings(source_set=2, other_source_set=1))
    device.answers = {} if answer is None else {2: answer}
    for _ in range(220):
        stage.step(0.1, pose=pose())
    assert device.sets == [2] * 5
    device.answers[2] = CommandAnswer(True, "")
    for _ in range(600):
        stage.step(0.1, pose=pose())
    assert device.sets == [2] * (5 if answer is None else 6)


def test_an_autopilot_that_was_away_or_restarted_is_requested_again_to_use_the_set_of_sources() -> None:
    device = Device()
    device.answers[2] = CommandAnswer(True, "")
    stage = Stage(VisionPoseDriver(device), VisionPoseSettings(source_set=2, other_source_set=1))
    for _ in range(600):
        stage.step(0.1, pose=pose())
    assert device.sets == [2]
    device.contacts += 1
    for _ in range(600):
        stage.step(0.1, pose=pose())
    assert device.sets == [2, 2]


def test_a_quiet_driver_that_resumes_requests_the_set_of_sources_within_seconds() -> None:
    device = Device()
    device.answers[2] = CommandAnswer(True, "")
    stage = Stage(VisionPoseDriver(device), VisionPoseSettings(source_set=2, other_source_set=1))
    stage.is_quiet = True
    for _ in range(300):
        stage.step(0.1, pose=pose())
    stage.is_quiet = False
    for _ in range(300):
        stage.step(0.1, pose=pose())
    assert device.sets == [2]


def test_without_the_setting_the_choice_is_left_alone() -> None:
    device = Device()
    stage = Stage(VisionPoseDriver(device))
    for _ in range(100):
        stage.step(0.05, pose=pose())
    assert device.sets == []


@pytest.mark.parametrize("style", ["px4", "ardupilot"])
def test_sources_and_home_in_the_words_of_each_style(style: str) -> None:
    with Rig(style) as rig:
        rig.run(4.0)
        sources, home = rig.device.command_source_set(2), rig.device.command_home((47.0, 8.0, 400.0))
        rig.run(0.5)
        answer = rig.device.answer(sources)
        assert answer is not None
        assert answer.is_accepted == (style == "ardupilot")
        assert rig.requested(42007) == ([] if style == "px4" else [(2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)])
        assert rig.requested(179)[0][4:] == pytest.approx((47.0, 8.0, 400.0))
        assert rig.device.answer(home) == (True, "")
