"""The components around the features of a stereo pair and the stereo odometer."""

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
import pytest
from tests.onboard.algorithms.vision.wall import cameras, poll
from tests.onboard.messages import at

from gloc3.camera.model import CameraModel
from gloc3.component.deployment import ComponentRow
from gloc3.component.lci import State
from gloc3.component.ports import Inbox, PortReport, inbox_of
from gloc3.component.test_bench import Bench
from gloc3.errors import Refused
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import rotate
from gloc3.messages.perception import UNKNOWN_VARIANCE, Features, ImuSample, Odometry
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import Image
from gloc3_onboard.algorithms.vision.picture import Picture
from gloc3_onboard.algorithms.vision.stereo_motion import BEGUN
from gloc3_onboard.components.processors.features import FeatureProcessor, FeatureSettings
from gloc3_onboard.components.processors.stereo_odometry import StereoOdometryProcessor, StereoOdometrySettings

RATE_HZ, STEP_M = 15.0, 0.02


class Calibrated:
    """The cameras that are calibrated."""

    def model(self, camera: str) -> CameraModel | None:
        return dict(zip(("front_left", "front_right"), cameras(), strict=True)).get(camera)


def image(camera: str, pixels: Picture, t_s: float) -> Envelope[Image]:
    height, width = pixels.shape
    return at(t_s, Image(camera=camera, width=width, height=height, data=pixels.tobytes()))


def pair(n: int) -> tuple[Envelope[Image], Envelope[Image]]:
    left, right = poll(STEP_M * n, seed=n)
    return image("front_left", left, n / RATE_HZ), image("front_right", right, n / RATE_HZ)


def reported(results: Sequence[Any]) -> Any:
    (result,) = results
    assert isinstance(result, PortReport)
    return result


@pytest.fixture
def matching() -> FeatureProcessor:
    component = FeatureProcessor(Calibrated())
    component.initialize(FeatureSettings())
    component.start()
    return component


@pytest.fixture
def moving() -> StereoOdometryProcessor:
    component = StereoOdometryProcessor(Calibrated())
    component.initialize(StereoOdometrySettings())
    component.start()
    return component


def both(matching: FeatureProcessor, moving: StereoOdometryProcessor, n: int) -> Odometry:
    left, right = pair(n)
    features = reported(matching.work(n / RATE_HZ, inbox_of(left=left, right=right)))
    assert features.t_s == n / RATE_HZ
    odometry = reported(moving.work(n / RATE_HZ, inbox_of(features=at(features.t_s, features.message))))
    assert odometry.t_s == n / RATE_HZ
    message = odometry.message
    assert isinstance(message, Odometry)
    return message


def test_pairs_become_features_and_features_motions(
    matching: FeatureProcessor, moving: StereoOdometryProcessor
) -> None:
    found = [both(matching, moving, n) for n in range(8)]
    assert (found[0].is_valid, found[0].reason, found[0].covariance[0]) == (False, BEGUN, UNKNOWN_VARIANCE)
    assert all(odometry.is_valid for odometry in found[1:])
    last = found[-1]
    assert last.reference_t_s == 0.0
    assert last.position_m == pytest.approx((0.0, 7 * STEP_M, 0.0), abs=0.006)
    assert rotate(last.reference_from_frd, (1.0, 0.0, 0.0)) == pytest.approx((1.0, 0.0, 0.0), abs=0.005)
    covariance = np.array(last.covariance).reshape(6, 6)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert np.sqrt(covariance[0, 0]) < 0.01
    assert 0.3 < last.quality <= 1.0
    assert matching.points > 20


def test_pictures_wait_for_those_of_the_other_eye(matching: FeatureProcessor) -> None:
    left, right = pair(0)
    assert matching.work(0.0, inbox_of(left=left)) == []
    assert reported(matching.work(0.01, inbox_of(right=right))).message.is_valid


def test_a_picture_without_the_other_eyes_is_told(matching: FeatureProcessor) -> None:
    results = [matching.work(n / RATE_HZ, inbox_of(left=pair(n)[0])) for n in range(5)]
    message = reported(next(result for result in results if result)).message
    assert message.reason == "there is no picture of front_right at the same time"


def test_what_comes_too_fast_is_skipped(matching: FeatureProcessor) -> None:
    pairs = [pair(n) for n in range(3)]
    result = reported(
        matching.work(1.0, inbox_of(left=[left for left, _ in pairs], right=[right for _, right in pairs]))
    )
    assert result.t_s == 2 / RATE_HZ
    assert matching.skipped == 2


def test_pictures_that_are_marked_or_torn_are_told_and_the_next_are_right(
    matching: FeatureProcessor, moving: StereoOdometryProcessor
) -> None:
    both(matching, moving, 0)
    left, right = pair(1)
    marked = msgspec.structs.replace(left.payload, is_valid=False, reason="black: its mean is 3 of 255")
    bad = reported(matching.work(0.07, inbox_of(left=at(left.t_s, marked), right=right)))
    assert bad.message.reason == "front_left: black: its mean is 3 of 255"
    lost = reported(moving.work(0.07, inbox_of(features=at(bad.t_s, bad.message)))).message
    assert (lost.is_valid, lost.quality, lost.reason) == (False, 0.0, bad.message.reason)
    assert lost.covariance[0] == UNKNOWN_VARIANCE
    left, right = pair(2)
    torn = msgspec.structs.replace(right.payload, data=right.payload.data[:1000])
    result = reported(matching.work(0.14, inbox_of(left=left, right=at(right.t_s, torn))))
    assert result.message.reason == "front_right: the picture is torn"
    assert both(matching, moving, 3).position_m[1] == pytest.approx(3 * STEP_M, abs=0.005)
    assert matching.refused == 2


def test_silence_is_told_once_a_second(matching: FeatureProcessor, moving: StereoOdometryProcessor) -> None:
    nothing = Inbox({}, {})
    text = [(matching.work(t_s / 10.0, nothing), moving.work(t_s / 10.0, nothing)) for t_s in range(21)]
    assert sum(bool(features) for features, _ in text) == sum(bool(odometry) for _, odometry in text) == 2
    assert matching.reason == "no pair of pictures received"
    assert moving.reason == "no features received"


@pytest.mark.parametrize(
    "damage",
    [
        {"ids": b"\x00\x00\x00"},
        {"pixels": b""},
        {"right_pixels": b"\x00" * 8},
        {"pixels": np.full((30, 2), np.nan, "<f4").tobytes(), "ids": np.arange(30, dtype="<i4").tobytes()},
        {"ids": b"", "pixels": b"", "right_pixels": b""},
    ],
)
def test_damaged_features_are_told(
    matching: FeatureProcessor, moving: StereoOdometryProcessor, damage: dict[str, bytes]
) -> None:
    left, right = pair(0)
    good = reported(matching.work(0.0, inbox_of(left=left, right=right))).message
    assert isinstance(good, Features)
    bad = msgspec.structs.replace(good, **damage)
    assert reported(moving.work(0.0, inbox_of(features=at(0.0, bad)))).message.reason == "the features are damaged"
    assert reported(moving.work(0.1, inbox_of(features=at(0.1, good)))).message.reason == BEGUN
    again = reported(moving.work(0.1, inbox_of(features=at(0.05, good)))).message
    assert again.reason == "the time does not grow"


def resting(t_s: float, *, is_valid: bool = True) -> ImuSample:
    """Gyros with the noise of real ones; marked as unusable they turn."""
    p, q, r = np.random.default_rng(round(1e3 * t_s) + 1000).normal(0.0, 1e-3, 3).tolist()
    return ImuSample(
        rate_frd_rad_s=(p, q, r) if is_valid else (9.0, 9.0, 9.0),
        specific_force_frd_m_s2=(0.0, 0.0, -9.81),
        is_valid=is_valid,
    )


def test_with_an_inertial_unit_a_black_picture_is_bridged_and_bound_nowhere_it_is_told() -> None:
    def row(name: str, odometry: str, **ports: str) -> ComponentRow:
        class_name = "gloc3_onboard.components.processors.stereo_odometry:StereoOdometryProcessor"
        bound: dict[str, str | list[str]] = {"features": "features/front", "odometry": odometry, **ports}
        return ComponentRow(name=name, class_name=class_name, trigger="features", ports=bound)

    features = ComponentRow(
        name="features",
        class_name="gloc3_onboard.components.processors.features:FeatureProcessor",
        trigger="right",
        ports={
            "left": "camera/front_left",
            "right": "camera/front_right",
            "features": "features/front",
            "inertial": "imu",
        },
    )
    with Bench(topics=TopicTable.installed()) as bench:
        bench.host(features, lambda: FeatureProcessor(Calibrated()))
        bench.host(row("with", "odometry/stereo", inertial="imu"), lambda: StereoOdometryProcessor(Calibrated()))
        bench.host(row("without", "odometry/second"), lambda: StereoOdometryProcessor(Calibrated()))
        bench.run(0.1)
        for n in range(8):
            for sample in range(10):
                t_s = (n - 1 + sample / 10.0) / RATE_HZ
                bench.send("imu", resting(t_s, is_valid=sample != 5), t_s=t_s)
            for topic, envelope in zip(("camera/front_left", "camera/front_right"), pair(n), strict=True):
                image = envelope.payload
                if n == 5:
                    image = msgspec.structs.replace(image, is_valid=False, reason="black: its mean is 3 of 255")
                bench.send(topic, image, t_s=envelope.t_s)
            bench.run(1.0 / RATE_HZ)
        found, without = bench.all("odometry/stereo"), bench.all("odometry/second")
        assert [odometry.is_valid for odometry in without] == [False, True, True, True, True, False, True, True]
        assert [odometry.is_valid for odometry in found] == [False] + [True] * 7
        assert found[5].reason == "held by the gyros: front_left: black: its mean is 3 of 255"
        assert found[5].position_m[1] == pytest.approx(5 * STEP_M, abs=0.01)
        assert found[5].quality < found[4].quality
        assert found[5].covariance[0] > found[4].covariance[0]


def test_cameras_that_are_not_calibrated_are_refused() -> None:
    with pytest.raises(Refused, match="no calibration of a camera 'nose'"):
        FeatureProcessor(Calibrated()).initialize(FeatureSettings(left="nose"))
    with pytest.raises(Refused, match="no calibration of a camera 'nose'"):
        StereoOdometryProcessor(Calibrated()).initialize(StereoOdometrySettings(right="nose"))
    with pytest.raises(Refused, match="exchange them"):
        FeatureProcessor(Calibrated()).initialize(FeatureSettings(left="front_right", right="front_left"))


def test_features_that_are_found_once_serve_two_odometers_under_their_hosts() -> None:
    rows = [
        ComponentRow(
            name="features",
            class_name="gloc3_onboard.components.processors.features:FeatureProcessor",
            trigger=["left", "right"],
            ports={"left": "camera/front_left", "right": "camera/front_right", "features": "features/front"},
        ),
        ComponentRow(
            name="stereo_odometry",
            class_name="gloc3_onboard.components.processors.stereo_odometry:StereoOdometryProcessor",
            trigger="features",
            ports={"features": "features/front", "odometry": "odometry/stereo"},
        ),
        ComponentRow(
            name="second",
            class_name="gloc3_onboard.components.processors.stereo_odometry:StereoOdometryProcessor",
            trigger="features",
            ports={"features": "features/front", "odometry": "odometry/second"},
        ),
    ]
    with Bench(topics=TopicTable.installed()) as bench:
        bench.host(rows[0], lambda: FeatureProcessor(Calibrated()))
        for row in rows[1:]:
            bench.host(row, lambda: StereoOdometryProcessor(Calibrated()))
        bench.run(0.1)
        for n in range(4):
            for topic, envelope in zip(("camera/front_left", "camera/front_right"), pair(n), strict=True):
                bench.send(topic, envelope.payload, t_s=envelope.t_s)
            bench.run(1.0 / RATE_HZ)
        found = bench.all("odometry/stereo")
        assert [odometry.is_valid for odometry in found] == [False, True, True, True]
        assert found[-1].position_m[1] == pytest.approx(3 * STEP_M, abs=0.005)
        assert bench.state("stereo_odometry") is State.WORKING
        assert bench.all("odometry/second") == found
        assert len(bench.all("features/front")) == 4
