"""Samplers mark what cannot be used, with a reason, and go on by themselves; they are faulty only without a device."""

import math
from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from tests.onboard.scripted_sources import HEIGHT, WIDTH, OneModel, ScriptedSource, depth, measured, picture, scan

from gloc3.component.component import Component
from gloc3.component.deployment import ComponentRow
from gloc3.component.lci import State
from gloc3.component.test_bench import Bench
from gloc3.messages.perception import DepthImage, ImuSample, LaserScan
from gloc3.messages.vehicle import Image
from gloc3_onboard.components.samplers.camera import CameraSampler
from gloc3_onboard.components.samplers.depth_camera import DepthCameraSampler
from gloc3_onboard.components.samplers.imu import ImuSampler
from gloc3_onboard.components.samplers.laser import LaserSampler
from gloc3_onboard.components.samplers.stereo_camera import StereoCameraSampler
from gloc3_onboard.sensors.devices import StampedDepth, StampedImage, StampedImu, StampedPair, StampedScan

PERIOD_S = 0.05


def hosted(bench: Bench, create: Callable[[ScriptedSource], Component[Any]], **settings: Any) -> ScriptedSource:
    source = ScriptedSource()
    row = ComponentRow(name="sampler", class_name="x:Y", rate_hz=20.0, settings=settings)
    bench.host(row, lambda: create(source))
    return source


def show(bench: Bench, source: ScriptedSource, image: Image, t_s: float | None = None) -> Image:
    """What becomes of a picture; by default one of now."""
    source.now_frame = StampedImage(bench.loop.time() if t_s is None else t_s, image)
    source.bell.ring()
    bench.run(PERIOD_S)
    found = bench.last("image")
    assert isinstance(found, Image)
    return found


def flat(value: int) -> Image:
    return msgspec.structs.replace(picture(), data=bytes([value]) * (WIDTH * HEIGHT))


def half(value: int) -> Image:
    data = picture(7).data
    return msgspec.structs.replace(picture(), data=data[: len(data) // 2] + bytes([value]) * (len(data) // 2))


BAD = {
    "black": (flat(2), "black"),
    "white": (flat(255), "white"),
    "half of it missing": (half(0), "torn: the last 24"),
    "half of it undecoded": (half(128), "torn: the last 24"),
    "too few bytes": (msgspec.structs.replace(picture(), data=picture().data[:-5]), "torn"),
    "no bytes": (msgspec.structs.replace(picture(), data=b""), "torn"),
    "another size": (picture(3, 32, 24), "the calibration is for 64 x 48"),
    "sized 0": (picture(3, 0, 0), "torn"),
    "told invalid": (msgspec.structs.replace(picture(), is_valid=False, reason="shutter closed"), "shutter closed"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_picture_that_cannot_be_used_is_marked_and_the_next_good_one_is_not(name: str) -> None:
    image, reason = BAD[name]
    with Bench() as bench:
        source = hosted(bench, lambda source: CameraSampler(source, OneModel()))
        assert show(bench, source, picture(1)).is_valid
        bad = show(bench, source, image)
        assert not bad.is_valid
        assert reason in bad.reason
        assert show(bench, source, picture(2)).is_valid
        assert bench.state("sampler") is State.WORKING


def test_a_dark_picture_with_a_light_in_it_can_be_used() -> None:
    dark = bytearray(flat(2).data)
    dark[1000] = 255
    with Bench() as bench:
        source = hosted(bench, CameraSampler)
        assert show(bench, source, msgspec.structs.replace(picture(), data=bytes(dark))).is_valid


def test_a_camera_that_gives_the_same_picture_again_is_stuck_unless_it_may_be() -> None:
    for may_repeat in (False, True):
        with Bench() as bench:
            source = hosted(bench, CameraSampler, may_repeat=may_repeat)
            show(bench, source, picture(1))
            assert show(bench, source, picture(1)).is_valid is may_repeat
            assert show(bench, source, picture(2)).is_valid


def test_pictures_from_the_past_and_the_future_are_marked_and_reported_as_of_now() -> None:
    with Bench() as bench:
        source = hosted(bench, CameraSampler)
        bench.run(1.0)
        show(bench, source, picture(1))
        for number, aside_s in enumerate((-0.5, +0.5), start=2):
            now_s = bench.loop.time()
            found = show(bench, source, picture(number), now_s + aside_s)
            assert not found.is_valid
            assert ("goes back" if aside_s < 0.0 else "ahead of the present") in found.reason
            assert bench.envelopes[-1].t_s == pytest.approx(now_s, abs=PERIOD_S)
        assert show(bench, source, picture(9)).is_valid


@pytest.mark.parametrize("stamp_s", [math.inf, -math.inf, math.nan])
def test_a_picture_without_a_time_is_marked_and_reported_as_of_now(stamp_s: float) -> None:
    with Bench() as bench:
        source = hosted(bench, CameraSampler)
        bench.run(1.0)
        assert show(bench, source, picture(1), stamp_s).reason == "the picture has no time of validity"
        assert show(bench, source, picture(2)).is_valid
        assert bench.state("sampler") is State.WORKING


def test_a_clock_that_begins_anew_is_believed_after_some_pictures_in_order() -> None:
    with Bench() as bench:
        source = hosted(bench, CameraSampler)
        bench.run(100.0)
        begin_s = bench.loop.time()
        show(bench, source, picture(0))
        found = [show(bench, source, picture(n), begin_s - 0.6 + 0.05 * n).is_valid for n in range(1, 9)]
        assert found == [False] * 4 + [True] * 4


def test_a_picture_of_long_ago_is_marked_as_old_and_keeps_its_time() -> None:
    with Bench() as bench:
        source = hosted(bench, CameraSampler)
        bench.run(10.0)
        found = show(bench, source, picture(1), 2.0)
        assert found.reason == "the picture is 8.0 s old"
        assert bench.envelopes[-1].t_s == 2.0
        assert show(bench, source, picture(2)).is_valid


def test_missing_pictures_are_told_once_a_second_until_they_come_again() -> None:
    with Bench() as bench:
        source = hosted(bench, CameraSampler)
        show(bench, source, picture(1))
        bench.envelopes.clear()
        bench.run(3.5)
        reasons = [image.reason for image in bench.all("image")]
        assert reasons == ["no picture for 1.0 s", "no picture for 2.0 s", "no picture for 3.0 s"]
        assert show(bench, source, picture(2)).is_valid
        assert bench.state("sampler") is State.WORKING


def test_a_camera_that_is_gone_for_good_makes_the_sampler_faulty_with_what_to_do() -> None:
    with Bench() as bench:
        source = hosted(bench, CameraSampler)
        source.lost = "/dev/video0 is gone; plug it in again"
        bench.run(0.2)
        assert bench.state("sampler") is State.FAULTY
        reply = bench.command("sampler", "initialize", None, "start")
        assert "plug it in again" in reply.reason
        source.lost = ""
        bench.command("sampler", "initialize", None, "start")
        assert show(bench, source, picture(1)).is_valid


def test_one_bad_picture_of_a_pair_leaves_the_other_one_valid() -> None:
    with Bench() as bench:
        source = hosted(bench, lambda source: StereoCameraSampler(source, OneModel()))
        source.now_pair = StampedPair(0.0, picture(1, camera="l"), flat(255))
        bench.run(PERIOD_S)
        left, right = bench.last("left"), bench.last("right")
        assert (left.camera, left.is_valid) == ("l", True)
        assert not right.is_valid
        bench.run(1.1)
        assert [(bench.last(side).camera, bench.last(side).reason) for side in ("left", "right")] == [
            ("l", "no pair of pictures for 1.0 s"),
            ("front", "no pair of pictures for 1.0 s"),
        ]


# --- scanners ---

SOME = [1.0, 2.0, 3.0, 4.0]
SCANS = {
    "no numbers": ([math.nan] * 4, "no beam is a number"),
    "all zero": ([0.0] * 4, "no beam reads more than 0.1 m"),
    "garbage": ([5.0 + 4.9 * math.sin(index * index) for index in range(360)], "its beams are unrelated to"),
    "all negative": ([-1.0] * 4, "no beam reads more than 0.1 m"),
    "no beams": ([], "torn"),
}


def turn(bench: Bench, source: ScriptedSource, given: LaserScan) -> LaserScan:
    source.now_scan = StampedScan(bench.loop.time(), given)
    source.bell.ring()
    bench.run(PERIOD_S)
    found = bench.last("laser")
    assert isinstance(found, LaserScan)
    return found


@pytest.mark.parametrize("name", SCANS)
def test_a_scan_that_cannot_be_used_is_marked_and_the_next_good_one_is_not(name: str) -> None:
    ranges, reason = SCANS[name]
    with Bench() as bench:
        source = hosted(bench, LaserSampler)
        bad = turn(bench, source, scan(ranges))
        assert not bad.is_valid
        assert reason in bad.reason
        assert turn(bench, source, scan(SOME)).is_valid


def test_scans_of_impossible_shape_are_marked() -> None:
    good = scan(SOME)
    for changes, reason in (
        ({"ranges_m": good.ranges_m[:-1]}, "torn"),
        ({"angle_step_rad": 0.0}, "directions"),
        ({"angle_min_rad": math.nan}, "directions"),
        ({"range_min_m": 50.0}, "ranges"),
        ({"is_valid": False, "reason": "the motor stands"}, "the motor stands"),
    ):
        with Bench() as bench:
            source = hosted(bench, LaserSampler)
            found = turn(bench, source, msgspec.structs.replace(good, **changes))
            assert not found.is_valid
            assert reason in found.reason


def test_single_beams_that_are_no_numbers_become_beams_without_a_reading_and_far_ones_stay_far() -> None:
    with Bench() as bench:
        source = hosted(bench, LaserSampler)
        found = turn(bench, source, scan([1.0, math.nan, math.inf, -3.0, 40.0]))
        assert found.is_valid
        assert found.ranges_m == scan([1.0, 0.0, math.inf, 0.0, 40.0]).ranges_m
        assert turn(bench, source, scan([40.0] * 5)).is_valid, "nothing is seen in the open"


def test_a_wall_looks_like_a_place_from_any_side_and_seen_by_some_beams_only() -> None:
    with Bench() as bench:
        source = hosted(bench, LaserSampler)
        for side in range(0, 360, 30):
            walls = [2.0 / max(abs(math.cos(math.radians(index + side))), 0.05) for index in range(360)]
            assert turn(bench, source, scan(walls)).is_valid
            assert turn(bench, source, scan([wall if index % 3 else 0.0 for index, wall in enumerate(walls)])).is_valid


def test_a_silent_scanner_is_told() -> None:
    with Bench() as bench:
        hosted(bench, LaserSampler, silent_s=0.3)
        bench.run(0.35)
        assert bench.last("laser").reason == "no scan for 0.3 s"


# --- inertial units ---


def test_every_sample_is_reported_once_with_its_own_time() -> None:
    with Bench() as bench:
        source = hosted(bench, ImuSampler)
        for number in range(20):
            now_s = bench.loop.time()
            source.measured += [measured(now_s + 0.01 * step, 0.001 * number + 0.0001 * step) for step in range(5)]
            bench.run(PERIOD_S)
        found = [envelope.t_s for envelope in bench.envelopes if envelope.topic == "bench/imu"]
        assert found == [stamped.t_s for stamped in source.measured]
        assert all(sample.is_valid for sample in bench.all("imu"))


@pytest.mark.parametrize(
    ("rate_rad_s", "reason"), [(math.nan, "not a number"), (math.inf, "not a number"), (100.0, "out of range")]
)
def test_a_sample_that_cannot_be_is_marked(rate_rad_s: float, reason: str) -> None:
    with Bench() as bench:
        source = hosted(bench, ImuSampler)
        source.measured = [measured(0.0, rate_rad_s)]
        bench.run(PERIOD_S)
        assert reason in bench.last("imu").reason
        source.measured = [measured(0.01)]
        bench.run(PERIOD_S)
        assert bench.last("imu").is_valid


def test_a_unit_that_always_says_the_same_is_stuck() -> None:
    with Bench() as bench:
        source = hosted(bench, ImuSampler)
        source.measured = [measured(0.001 * number) for number in range(51)]
        bench.run(PERIOD_S)
        assert [sample.is_valid for sample in bench.all("imu")] == [True] * 50 + [False]
        assert "stuck" in bench.last("imu").reason


def test_a_silent_unit_is_told_and_an_impossible_force_is_marked() -> None:
    with Bench() as bench:
        source = hosted(bench, ImuSampler)
        bench.run(0.6)
        assert bench.last("imu").reason == "no sample for 0.5 s"
        thrown = ImuSample(rate_frd_rad_s=(0.0, 0.0, 0.0), specific_force_frd_m_s2=(400.0, 0.0, 0.0))
        source.measured = [StampedImu(bench.loop.time(), thrown)]
        bench.run(PERIOD_S)
        assert "400 m/s2" in bench.last("imu").reason


# --- depth ---


def show_depth(bench: Bench, source: ScriptedSource, found: DepthImage) -> DepthImage:
    """What becomes of a depth picture of now."""
    source.now_depth = StampedDepth(bench.loop.time(), found)
    source.bell.ring()
    bench.run(PERIOD_S)
    reported = bench.last("depth")
    assert isinstance(reported, DepthImage)
    return reported


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({"data": depth(3).data[:-2]}, "torn"),
        ({"width": 0}, "torn"),
        ({"width": 32, "height": 96}, "the calibration is for 64 x 48"),
        ({"scale_m": math.nan}, "its unit of nan m is impossible"),
        ({"range_min_m": 20.0}, "its ranges from 20 to 10 m are impossible"),
        ({"data": depth(1).data}, "the same picture again"),
        ({"is_valid": False, "reason": "overheated"}, "overheated"),
    ],
)
def test_a_depth_picture_that_cannot_be_used_is_marked_and_the_next_good_one_is_not(
    wrong: dict[str, Any], reason: str
) -> None:
    with Bench() as bench:
        source = hosted(bench, lambda source: DepthCameraSampler(source, OneModel()))
        assert show_depth(bench, source, depth(1)).is_valid
        found = show_depth(bench, source, msgspec.structs.replace(depth(2), **wrong))
        assert not found.is_valid
        assert reason in found.reason
        assert show_depth(bench, source, depth(4)).is_valid


def test_pictures_without_any_depth_are_valid_and_no_pictures_are_reported() -> None:
    with Bench() as bench:
        source = hosted(bench, lambda source: DepthCameraSampler(source, OneModel()))
        nothing = msgspec.structs.replace(depth(), data=bytes(len(depth().data)))
        assert show_depth(bench, source, nothing).is_valid
        assert show_depth(bench, source, nothing).is_valid
        bench.run(1.2)
        found = bench.last("depth")
        assert isinstance(found, DepthImage)
        assert (found.is_valid, found.camera) == (False, "depth")
        assert "no picture for 1.0 s" in found.reason
