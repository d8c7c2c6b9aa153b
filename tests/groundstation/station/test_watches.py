"""What a station asks platforms to show it, and what it keeps of what comes: a machine without I/O."""

from itertools import count
from typing import Any

import pytest

from gloc3.messages.command_interface import Watch
from gloc3.messages.envelope import Envelope, Message, Source
from gloc3.messages.link_traffic import LinkTraffic
from gloc3.messages.readiness import ComputerState, LinkCondition
from gloc3.messages.standard_topics import TOPICS
from gloc3.messages.topics import TopicTable
from gloc3.messages.units import split_unit
from gloc3.messages.vehicle import HeightAboveGround, Pose
from gloc3.messages.watch import LEASE_S, RENEW_S, Preview, TopicActivity, TopicEntry, Want, pack
from gloc3.messages.wire import type_name
from gloc3_groundstation.station.message_fields import fields_of, numbers_of
from gloc3_groundstation.station.preview_size import SIZES, PreviewSize
from gloc3_groundstation.station.watches import HISTORY, Watches

POSE = Want("pose", 5.0)


@pytest.fixture
def watches() -> Watches:
    return Watches(TopicTable(TOPICS).types)


COUNT = count()


def sample(topic: str, message: Message, t_s: float, name: str = "heron") -> Envelope[Any]:
    envelope: Envelope[Any] = Envelope(
        f"{name}/{topic}", Source(name, "somebody", 3), 0, t_s, "ned", type_name(type(message)), message
    )
    packed = pack(envelope, message, 20.0, ("255",))
    return Envelope(
        f"{name}/watch/sample/{topic}", Source(name, "viewer", 9), next(COUNT), t_s, "", type_name(type(packed)), packed
    )


def height(height_m: float) -> HeightAboveGround:
    return HeightAboveGround(height_m=height_m, is_valid=True)


def test_what_somebody_wants_is_asked_at_once_again_before_the_lease_ends_and_ended_when_nobody_looks(
    watches: Watches,
) -> None:
    watches.watch("screen", "heron", [POSE], 10.0)
    assert watches.due(10.0) == [("heron", Watch(wants=[POSE]))]
    assert watches.due(10.1) == []
    assert watches.next_s() == 10.0 + RENEW_S
    assert watches.due(10.0 + RENEW_S) == [("heron", Watch(wants=[POSE]))]
    assert 2.0 * RENEW_S < LEASE_S
    watches.watch("screen", "heron", [], 14.0)
    assert watches.due(14.0) == [("heron", Watch())]
    assert watches.due(30.0) == []
    assert watches.next_s() is None


def test_a_viewer_that_does_not_look_again_in_time_is_forgotten(watches: Watches) -> None:
    watches.watch("screen", "heron", [POSE], 0.0, for_s=2.0)
    watches.due(0.0)
    assert watches.next_s() == 2.0
    assert watches.due(2.0) == [("heron", Watch())]


def test_two_viewers_share_one_request_and_get_what_the_more_demanding_one_wants(watches: Watches) -> None:
    watches.watch("screen", "heron", [Want("pose", 1.0), Want("camera/ground", 1.0, 96, 72)], 0.0, is_listing=True)
    watches.watch("foxglove", "heron", [Want("pose", 10.0), Want("camera/ground", 0.5, 320, 240)], 0.0)
    ((_, requested),) = watches.due(0.0)
    assert requested.is_listing
    assert requested.wants == [Want("camera/ground", 1.0, 320, 240), Want("pose", 10.0)]
    watches.unwatch("foxglove")
    ((_, requested),) = watches.due(1.0)
    assert requested.wants == [Want("camera/ground", 1.0, 96, 72), Want("pose", 1.0)]


def test_looking_at_another_vehicle_ends_the_look_at_the_one_before(watches: Watches) -> None:
    watches.watch("screen", "heron", [POSE], 0.0)
    watches.due(0.0)
    watches.unwatch("screen", except_from="egret")
    watches.watch("screen", "egret", [POSE], 1.0)
    assert watches.due(1.0) == [("heron", Watch()), ("egret", Watch(wants=[POSE]))]


def test_a_sample_is_the_message_as_it_was_published_and_its_numbers_are_kept_for_plots(watches: Watches) -> None:
    watches.watch("screen", "heron", [Want("height")], 0.0)
    watches.due(0.0)
    for step in range(HISTORY + 5):
        now_s = 0.1 * step
        seen = watches.receive(sample("height", height(1.0 + step), now_s), now_s)
        assert seen is not None
    sight = watches.sight("heron", "height", now_s)
    assert sight.envelope == seen
    assert sight.envelope is not None
    assert sight.envelope.topic == "heron/height"
    assert sight.rate_hz == pytest.approx(10.0, abs=0.1)
    assert sight.source_rate_hz == 20.0
    series = watches.series("heron", "height", "height_m")
    assert len(series) == HISTORY
    assert series[-1][0] == pytest.approx(now_s)
    assert series[-1][1] == (1.0 + step,)
    assert watches.sight("heron", "height", now_s + 20.0).rate_hz < 2.0, "what does not come any more has no rate"


def test_samples_that_a_link_held_back_and_brings_at_once_have_the_rate_at_which_they_were_taken(
    watches: Watches,
) -> None:
    watches.watch("screen", "heron", [Want("height")], 0.0)
    watches.due(0.0)
    for step in range(30):
        watches.receive(sample("height", height(1.0), 0.2 * step), 6.0 + 1e-5 * step)
    assert watches.sight("heron", "height", 6.1).rate_hz == pytest.approx(5.0, abs=0.1)


def test_what_is_said_not_to_be_valid_is_shown_and_not_plotted(watches: Watches) -> None:
    watches.watch("screen", "heron", [Want("height")], 0.0)
    watches.due(0.0)
    for step, height_m in enumerate((1.0, 41.0, 1.1)):
        reported = HeightAboveGround(height_m=height_m, is_valid=height_m < 40.0)
        watches.receive(sample("height", reported, 0.1 * step), 0.1 * step)
    assert [numbers for _, numbers in watches.series("heron", "height", "height_m")] == [(1.0,), (1.1,)]
    assert len(watches.series("heron", "height", "is_valid")) == 3


def test_a_sample_that_comes_by_two_links_counts_once(watches: Watches) -> None:
    watches.watch("screen", "heron", [Want("height")], 0.0)
    watches.due(0.0)
    first, second = sample("height", height(1.0), 0.0), sample("height", height(2.0), 0.2)
    assert watches.receive(first, 0.1) is not None
    assert watches.receive(first, 0.15) is None
    assert watches.receive(second, 0.3) is not None
    assert watches.receive(first, 0.4) is None, "a slower link brings what is older"
    assert len(watches.series("heron", "height", "height_m")) == 2


def test_samples_that_others_look_at_are_not_kept(watches: Watches) -> None:
    assert watches.receive(sample("height", height(1.0), 0.0), 0.0) is None
    watches.watch("screen", "heron", [POSE], 0.0)
    watches.due(0.0)
    assert watches.receive(sample("height", height(1.0), 0.0), 0.0) is None
    assert watches.sight("heron", "height", 0.0).envelope is None


def test_a_vehicle_that_has_restarted_begins_its_plots_anew(watches: Watches) -> None:
    watches.watch("screen", "heron", [Want("height")], 0.0)
    watches.due(0.0)
    watches.receive(sample("height", height(1.0), 500.0), 1.0)
    watches.receive(sample("height", height(2.0), 3.0), 2.0)
    assert watches.series("heron", "height", "height_m") == [(3.0, (2.0,))]


def test_a_sample_that_cannot_be_read_says_why(watches: Watches) -> None:
    class Strange(Message, frozen=True):
        value: int

    watches.watch("screen", "heron", [Want("strange")], 0.0)
    watches.due(0.0)
    assert watches.receive(sample("strange", Strange(value=1), 0.0), 0.0) is None
    assert watches.sight("heron", "strange", 0.0).problem == "unknown message type 'Strange'"


def test_what_is_refused_is_told_at_the_topic_and_what_the_platform_cannot_do_at_all_of_them(watches: Watches) -> None:
    watches.watch("screen", "heron", [Want("hight"), POSE], 0.0)
    watches.due(0.0)
    watches.answered("heron", {"hight": "did you mean 'height'?"})
    assert watches.sight("heron", "hight", 0.0).problem == "did you mean 'height'?"
    assert watches.sight("heron", "pose", 0.0).problem == ""
    watches.answered("heron", {}, "this platform shows no topics")
    assert watches.sight("heron", "pose", 0.0).problem == "this platform shows no topics"


def test_the_list_is_asked_for_until_it_is_there(watches: Watches) -> None:
    watches.watch("screen", "heron", [], 0.0, is_listing=True)
    assert watches.lists_due() == ["heron"]
    watches.listed("heron", [TopicEntry("pose", "Pose", 20.0, "pose")])
    assert watches.lists_due() == []
    activity = TopicActivity(rates=[200], ages=[0])
    watches.receive(Envelope("heron/watch/activity", Source("heron", "viewer", 9), 0, 0.0, "", "", activity), 0.0)
    assert watches.activity("heron") == activity
    watches.due(0.0)
    watches.watch("screen", "heron", [], 1.0)
    watches.due(1.0)
    assert watches.activity("heron") is None, "what is not looked at is not known"


def test_pictures_grow_while_they_come_in_time_and_shrink_when_they_do_not() -> None:
    size = PreviewSize()
    assert size.size((200, 200)) == (64, 48)
    for second in range(9):
        size.came(float(second))
    assert size.size((200, 200)) == SIZES[2]
    size.came(13.0)
    assert size.size((200, 200)) == SIZES[1]
    for second in range(14, 40):
        size.came(float(second))
    assert size.size((200, 200)) == SIZES[1], "what was too much is not tried again"
    assert size.size((70, 40)) == (64, 48), "no more than can be shown"
    size.pause()
    size.came(100.0)
    assert size.size((200, 200)) == SIZES[1], "a pause of the operator is none of the link"


def test_a_preview_is_never_plotted(watches: Watches) -> None:
    preview = Preview(camera="front", width=64, height=48, full_width=640, full_height=480, data=b"x")
    watches.watch("screen", "heron", [Want("camera/front")], 0.0)
    watches.due(0.0)
    assert watches.receive(sample("camera/front", preview, 1.0), 1.0) is not None
    assert watches.series("heron", "camera/front", "width") == []


def test_names_tell_the_units() -> None:
    assert split_unit("speed_m_s") == ("speed", "m/s")
    assert split_unit("position_ned_m") == ("position_ned", "m")
    assert split_unit("rate_frd_rad_s") == ("rate_frd", "rad/s")
    assert split_unit("rate_deg_s") == ("rate", "°/s")
    assert split_unit("battery_percent") == ("battery", "%")
    assert split_unit("landed") == ("landed", "")


def test_a_message_is_told_field_by_field_and_long_rows_are_counted() -> None:
    pose = Pose(position_ned_m=(1.0, 2.0, 3.0), velocity_ned_m_s=(0.0, 0.0, 0.0), ned_from_frd=(1.0, 0.0, 0.0, 0.0))
    fields = {field.path: field for field in fields_of(pose)}
    assert fields["position_ned_m"].value == [1.0, 2.0, 3.0]
    assert fields["position_ned_m"].numbers == (1.0, 2.0, 3.0)
    assert fields["reason"].numbers == ()
    assert "position_ned_m" in numbers_of(pose)

    class Nested(Message, frozen=True):
        items: dict[str, Any]
        many: list[float]

    nested = fields_of(Nested(items={"clamped": 3, "deep": {"a": 1.5}}, many=[0.0] * 100))
    assert [(f.path, f.depth, f.value) for f in nested] == [
        ("items", 0, None),
        ("items.clamped", 1, 3),
        ("items.deep", 1, None),
        ("items.deep.a", 2, 1.5),
        ("many", 0, "100 items"),
    ]


def test_the_figures_of_each_link_have_names_also_where_they_travel_without() -> None:
    traffic = LinkTraffic(frames_in=7, dropped={"bulk": 2}, refused={"not signed": 3})
    links = [LinkCondition("udpin://:14550", "", 120), LinkCondition("serial:///dev/ttyUSB0", "", 0, traffic)]
    state = ComputerState(links=links)
    values = {field.path: field.value for field in fields_of(state)}
    assert values["links.1.url"] == "udpin://:14550"
    assert values["links.2.traffic.frames_in"] == 7
    assert values["links.2.traffic.dropped.bulk"] == 2
    assert values["links.2.traffic.refused.not signed"] == 3
