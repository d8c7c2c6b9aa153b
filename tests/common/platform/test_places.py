"""Components move between hosts and processes by a word in their row; a word that cannot hold is said at its line."""

import pytest

from gloc3.errors import Finding, InputError, Refused
from gloc3.platform.places import (
    ProcessPlace,
    child_processes,
    choose_host,
    clock_host,
    is_in_one_process,
    place_of,
    rows_at,
)
from gloc3.platform.platform import Platform
from gloc3.platform.reader import load_platform, read_platform

PLATFORM = """\
platform: pelican
vehicle: {type: quadrotor, mass_kg: 1.65}
hosts: {vision: {on_loss: hold}, vehicle: {}, base: {}}
devices: {stereo_camera: "tcp://127.0.0.1:5600", imu: "autopilot://"}
components:
  - {name: state, class: "somewhere:State", rate_hz: 20, devices: {device: autopilot}, host: vehicle}
  - {name: server, class: "somewhere:Server", rate_hz: 20, devices: {site: site}, host: vehicle}
  - {name: camera, class: "somewhere:Camera", rate_hz: 20, devices: {device: stereo_camera}, process: eyes}
  - {name: odometer, class: "somewhere:Odometer", rate_hz: 20, host: base}
  - {name: pose, class: "somewhere:Pose", rate_hz: 20, host: vehicle, process: fusion}
  - {name: pose_standby, class: "somewhere:Pose", rate_hz: 20, begin: quiet, standby_for: pose}
"""


def read(text: str = PLATFORM) -> Platform:
    return read_platform(text, "p")


def findings(text: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        read_platform(text, "p")
    return [str(finding) for finding in caught.value.findings]


def test_a_row_tells_host_and_process_and_without_a_word_it_is_the_first_host_s_main_process() -> None:
    platform = read()
    assert [str(place_of(platform, row)) for row in platform.components] == [
        "vehicle", "vehicle", "vision/eyes", "base", "vehicle/fusion", "vision",
    ]  # fmt: skip
    assert [row.name for row in rows_at(platform, ProcessPlace("vehicle"))] == ["state", "server"]
    assert child_processes(platform, "vehicle") == ["fusion"]
    assert not is_in_one_process(platform)


def test_the_clock_host_is_the_one_with_the_autopilot_s_link() -> None:
    assert clock_host(read()) == "vehicle"


def test_a_component_moves_by_one_word() -> None:
    moved = read(PLATFORM.replace("rate_hz: 20, host: base", "rate_hz: 20, host: vision, process: eyes"))
    assert [row.name for row in rows_at(moved, ProcessPlace("vision", "eyes"))] == ["camera", "odometer"]


def test_a_platform_without_hosts_is_one_process_that_is_called_main() -> None:
    platform = load_platform("pelican")
    assert is_in_one_process(platform)
    assert choose_host(platform, None) == clock_host(platform) == "main"
    assert len(rows_at(platform, ProcessPlace("main"))) == len(platform.components)


def test_which_host_this_is_must_be_said_where_there_are_several() -> None:
    with pytest.raises(Refused, match="has the hosts vision, vehicle, base: choose one, such as --host vision"):
        choose_host(read(), None)
    with pytest.raises(Refused, match="has no host 'vison'; did you mean 'vision'"):
        choose_host(read(), "vison")
    assert choose_host(read(), "base") == "base"


@pytest.mark.parametrize(
    ("word", "instead", "finding"),
    [
        ("host: base", "host: bse", "p:9:70: the platform has no host 'bse' (did you mean 'base'?)"),
        (
            "{site: site}, host: vehicle",
            "{site: site}, host: vehicle, process: own",
            "p:7:107: server needs the device 'site', which only the main process of vehicle has (not vehicle/own)",
        ),
        (
            "{site: site}, host: vehicle",
            "{site: site}",
            "p:7:5: server needs the device 'site', which only the main process of vehicle has (not vision)",
        ),
        (
            "rate_hz: 20, host: base",
            "rate_hz: 20, devices: {imu: imu}, host: base",
            "p:9:91: odometer needs the device 'imu', which only the main process of vehicle has (not base)",
        ),
        (
            "rate_hz: 20, host: base",
            "rate_hz: 20, devices: {pair: stereo_camera}, host: base",
            "p:9:73: camera has the device 'stereo_camera' open in vision/eyes, and odometer runs in base (a device belongs to one process: run both there)",
        ),
    ],
    ids=["unknown host", "server in a child", "server elsewhere", "autopilot's sensor elsewhere", "one device twice"],
)  # fmt: skip
def test_a_place_that_cannot_hold_is_told_at_its_word(word: str, instead: str, finding: str) -> None:
    text = PLATFORM.replace(word, instead)
    if "host: vehicle" in word and "host: vehicle" not in instead:  # the votes are even: one row more
        text += '  - {name: driver, class: "somewhere:Driver", rate_hz: 9, devices: {a: autopilot}, host: vehicle}\n'
    assert [found for found in findings(text) if "warning" not in found] == [finding]


def test_hosts_that_are_not_listed_are_asked_for() -> None:
    lines = [line for line in PLATFORM.splitlines() if not line.startswith("hosts:")]
    found = [finding for finding in findings("\n".join(lines)) if "warning" not in finding]
    assert found[0].endswith("the platform has no host 'vehicle' (list the computers under hosts:)")


def test_a_standby_that_ends_with_its_primary_is_doubted() -> None:
    doubts: list[Finding] = []
    text = PLATFORM.replace("standby_for: pose}", "standby_for: pose, host: vehicle, process: fusion}")
    read_platform(text, "p", warn=doubts.append)
    assert "if the process vehicle/fusion ends, pose and this standby of it both end" in str(doubts[-1])
