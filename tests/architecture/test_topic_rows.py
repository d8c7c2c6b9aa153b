"""Topics as rows: each has a type, somebody who produces it, and a sensible rate; the platform's own rows are right."""

from typing import Final

import pytest

from gloc3.component.deployment import PUBLISHED_BY_HOSTS, problems_of
from gloc3.messages.envelope import Message
from gloc3.messages.topics import TopicTable, matches
from gloc3.messages.wire import type_name
from gloc3.platform.reader import load_platform

TABLE = TopicTable.installed()
PLATFORMS = ("pelican",)

FROM_ELSEWHERE: Final = {
    "ci/request": "the stations, through their links",
    "ci/heard": "the links to the stations",
    "velocity_demand": "the stations, through their links",
    "ci/request/*": "the stations, over the network",
    "ci/ask/*": "the stations, over the network",
    "demand/*": "the stations, over the network",
    "*/health": "the routers of a network, below `regions/`",
    "*/revocations": "the members of a network, below `members/`",
    "ci/teleoperation": "the controller of a platform that is steered by hand",
    "gimbal": "the driver of a platform with a gimbal",
    "gimbal_demand": "the gimbal manager of the onboard computer",
    "acoustic": "the station's end of an acoustic modem",
    "sim/*": "the flight harness",
    "hosts/**": "the main process of each host",
    "host_presence": "the main process of the clock host",
    "ci/hosts": "the main process of the clock host",
    "ci/host_names": "the main process of the clock host",
    "imu": "the inertial unit of a platform that moves by its own sensors",
    "laser": "the range scanner of a platform that has one",
    "features/*": "the feature processor of a platform that has a stereo pair",
    "odometry/*": "the odometers of a platform that moves by its own sensors",
    "fusion/*": "the pose fusion of a platform that moves by its own sensors",
    "position_fix/*": "the optical follower of a platform that is looked at",
    "dvl": "the Doppler velocity log of a platform that dives",
    "satellites": "the receiver of a platform that dives or drives",
    "wheels": "the encoders of a platform that drives",
    "estimator_pose": "the estimator of a platform that has one of another maker",
    "obstacles": "the range scanner or depth camera of a platform that has one",
    "depth/*": "the depth camera of a platform that has one",
    "cloud/*": "the depth camera of a platform that has one",
}


def produced() -> set[str]:
    """The topics that the components of our platforms publish, a key as `*`."""
    found = {f"components/*/{what}" for what in PUBLISHED_BY_HOSTS}
    for name in PLATFORMS:
        for row in load_platform(name, is_loading_classes=True).components:
            for port in row.load_class().outputs:
                found |= {topic.replace("{key}", "*") for topic in row.topics(port)}
    return found


def test_every_topic_has_a_message_type_with_a_name_on_the_wire() -> None:
    for name, row in TABLE:
        assert issubclass(row.message, Message), name
        assert type_name(row.message).startswith(f"{row.message.__name__}#")


def test_every_topic_has_somebody_who_produces_it() -> None:
    known = [*produced(), *FROM_ELSEWHERE]
    orphans = [name for name, _ in TABLE if not any(matches(name, topic) or matches(topic, name) for topic in known)]
    assert orphans == []


def test_every_topic_has_a_rate_that_a_component_can_keep() -> None:
    for name, row in TABLE:
        assert 0.0 <= row.rate_hz <= 1000.0, name
        assert row.silent_after >= 2.0, name
        assert row.downlink_every >= 0, name


def test_the_pose_is_silent_after_three_periods() -> None:
    row = TABLE.row("pelican/pose")
    assert row is not None
    assert row.silent_after == 3.0


@pytest.mark.parametrize("name", PLATFORMS)
def test_our_platforms_rows_fit_their_classes_the_topics_and_each_other(name: str) -> None:
    rows = load_platform(name, is_loading_classes=True).components
    findings = list(problems_of(rows, TABLE, external=tuple(FROM_ELSEWHERE)))
    assert [str(finding) for finding in findings if not finding.is_warning] == []
