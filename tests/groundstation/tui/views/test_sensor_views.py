"""Topics, values, plots and plans of the sensors screen, read as text."""

import math

from msgspec.structs import replace
from tests.groundstation.looked_at import TOPICS, pose, preview

from gloc3.messages.envelope import Envelope, Source
from gloc3.messages.watch import TopicActivity, TopicEntry
from gloc3_groundstation.station.watches import Sight
from gloc3_groundstation.tui.views.sensors import (
    field_rows,
    no_topics_lines,
    plot_lines,
    preview_line,
    scan_lines,
    sight_line,
    topic_rows,
    topics_header,
)
from gloc3_groundstation.tui.widgets.lines import Line, Tone, text_of

ACTIVITY = TopicActivity(rates=[50, 200, 20, 200, 200, 0, 0, 200, 50], ages=[1, 0, 3, 0, 0, 62, -1, 0, 1])


def dots(lines: list[Line]) -> int:
    return sum(
        (ord(char) - 0x2800).bit_count() for line in lines for char in text_of(line) if 0x2800 < ord(char) < 0x2900
    )


def test_every_topic_tells_its_rate_against_nominal_and_its_age() -> None:
    rows = dict(topic_rows(TOPICS, ACTIVITY, "", 76))
    assert text_of(topics_header(76)).split() == ["topic", "type", "Hz", "of", "age"]
    assert text_of(rows["pose"]).split() == ["pose", "Pose", "20.0", "20", "0", "s"]
    assert text_of(rows["action_status/waypoints"]).split() == ["action_status/waypoints", "ActionStatus", "·"]


def test_a_topic_that_has_fallen_silent_looks_so_and_one_that_speaks_now_and_then_does_not() -> None:
    rows = dict(topic_rows(TOPICS, ACTIVITY, "", 76))
    assert Tone.STALE in {span.tone for span in rows["setpoint_wanted/waypoints"]}
    assert Tone.STALE not in {span.tone for span in rows["action_status/waypoints"]}
    never = topic_rows([TopicEntry("pose", "Pose", 20.0, "pose")], TopicActivity(rates=[0], ages=[-1]), "", 76)
    assert text_of(never[0][1]).split()[-1] == "silent"


def test_topics_are_found_by_name_type_and_component() -> None:
    for wanted, name in (("INTERN", "components/pose/internal"), ("image", "camera/ground"), ("limiter", "setpoint")):
        assert [key for key, _ in topic_rows(TOPICS, None, wanted, 40)] == [name]
    assert "requested by name" in " ".join(map(text_of, no_topics_lines(TOPICS, "nix", "", 80)))
    assert "no viewer" in text_of(no_topics_lines([], "", "it has no viewer", 80)[0])


def test_values_stand_with_their_units_and_old_ones_look_old() -> None:
    rows = dict(field_rows(pose(0.0), 60))
    assert text_of(rows["position_ned_m"]).split() == ["position", "ned", "4.000", "0.000", "-2.000", "m"]
    assert text_of(rows["is_valid"]).split() == ["is", "valid", "yes"]
    assert text_of(rows["sources"]).split() == ["sources", "autopilot", "stereo"]
    assert all(len(text_of(line)) <= 44 for _, line in field_rows(pose(0.0), 44))
    previous = dict(field_rows(pose(0.0), 60, is_stale=True))
    assert previous["position_ned_m"][-1].tone is Tone.STALE


def test_the_line_above_tells_how_much_of_a_topic_is_seen() -> None:
    envelope = Envelope("heron/pose", Source("heron", "pose", 1), 0, 5.0, "ned", "Pose", pose(0.0))
    seen = Sight("pose", envelope, 100.0, 4.9, 20.0, "")
    assert text_of(sight_line(seen, 5.0, 100.2, 60)).split() == [
        "publishes",
        "20.0",
        "Hz,",
        "received",
        "4.9",
        "of",
        "5",
        "Hz",
        "now",
    ]
    late = sight_line(seen, 5.0, 110.0, 60)
    assert "10 s ago" in text_of(late)
    assert {span.tone for span in late if span.text.strip()} == {Tone.STALE}
    assert "did you mean" in text_of(sight_line(Sight("x", None, 0.0, 0.0, 0.0, "did you mean 'y'?"), 1.0, 0.0, 60))


def test_a_row_of_numbers_is_drawn_in_a_strip_each_with_its_range() -> None:
    series = [(0.1 * n, (math.sin(0.1 * n), float(n), 5.0)) for n in range(100)]
    lines = plot_lines(series, 60, 9)
    texts = [text_of(line) for line in lines]
    assert len(lines) == 9
    assert all(len(text) <= 60 for text in texts)
    assert texts[0].split()[:2] == ["x", "1.000"]
    assert texts[3].split()[:2] == ["y", "99.000"]
    assert texts[5].split()[0] == "0.000"
    assert dots(lines) > 200


def test_a_preview_tells_its_size_and_one_without_a_picture_nothing() -> None:
    shown = preview(1.0)
    reported = preview_line(shown)
    assert reported.startswith(f"{shown.camera}: {shown.width}×{shown.height} of ")
    assert preview_line(replace(shown, width=0, height=0, full_width=0, full_height=0, data=b"")) == ""


def test_numbers_that_are_none_do_not_stop_a_plot() -> None:
    series = [(0.0, (math.nan,)), (1.0, (math.inf,)), (2.0, (1.0,)), (3.0, (2.0,))]
    assert dots(plot_lines(series, 40, 4)) > 10
    assert "no number" in text_of(plot_lines([(0.0, (math.nan,)), (1.0, (math.nan,))], 40, 4)[0])
    assert "waiting for more" in text_of(plot_lines([(0.0, (1.0,))], 40, 4)[0])


def test_a_scan_is_seen_from_above_with_north_up_and_one_scale() -> None:
    corners = [(0.0, 0.0), (10.0, 0.0), (10.0, 5.0), (0.0, 5.0)]
    lines = scan_lines(corners, 40, 11)
    assert dots(lines) == 4
    assert "4 points, 5.0 × 10.0 m" in text_of(lines[-1])
    rows = [y for y, line in enumerate(lines[:-1]) if dots([line])]
    columns = [x for line in lines for x, char in enumerate(text_of(line)) if 0x2800 < ord(char) < 0x2900]
    assert rows == [0, 9]
    assert max(columns) - min(columns) <= 10, "as wide as high where it is half as wide as high: 2 × 4 dots a character"
    assert "no hits" in text_of(scan_lines([], 40, 10)[0])
    assert len(scan_lines([(1.0, 1.0)], 40, 10)) == 10
