"""The recorder: what goes in comes out, in files that others read, the same bytes for the same run."""

import asyncio
import base64
import io
import json
import math
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from gloc3.clock import Clock, VirtualLoop
from gloc3.errors import Gloc3Error
from gloc3.exchange.base import LocalExchange
from gloc3.log.foxglove.schemas import PATH_SCHEMA, TRANSFORM_SCHEMA
from gloc3.log.info import summarize
from gloc3.log.json_schema import SCALARS
from gloc3.log.payloads import PROBLEM, PayloadEncoder
from gloc3.log.reader import LogReader
from gloc3.log.record import RUN, Recorder
from gloc3.messages.envelope import Event, InternalState, Message, Severity, Source
from gloc3.messages.standard_topics import TOPICS
from gloc3.messages.summaries import VehicleSummary
from gloc3.messages.topics import TopicRow, TopicTable
from gloc3.messages.vehicle import Image, Pose, Setpoint

from .samples import HEIGHT, POSE, REQUESTED, LogInMemory, flight_log, sample, small_log

TYPES = list(TopicTable(TOPICS).types)
POSE_MESSAGE = Pose(
    position_ned_m=(0.0, 0.0, -1.0), velocity_ned_m_s=(0.0, 0.0, 0.0), ned_from_frd=(1.0, 0.0, 0.0, 0.0)
)


class Nothing(Message, frozen=True):
    """A message without fields."""


def read(data: bytes, tmp_path: Path, topics: TopicTable | None = None) -> list[Any]:
    """The envelopes of a log."""
    file = tmp_path / "log.mcap"
    file.write_bytes(data)
    with LogReader(file, (topics or TopicTable(TOPICS)).types) as reader:
        found = [entry.envelope for entry in reader.entries()]
        assert not reader.losses()
        return found


def objects(data: bytes, topic: str) -> list[dict[str, Any]]:
    """The JSON objects of a topic, read by the mcap library."""
    return [
        json.loads(message.data)
        for _, channel, message in make_reader(io.BytesIO(data)).iter_messages(topics=[topic])
        if channel.message_encoding == "json"
    ]


def test_every_message_type_comes_back_as_it_was(tmp_path: Path) -> None:
    random = Random(1)
    table = TopicTable({f"sample/{kind.__name__}": TopicRow(kind) for kind in TYPES})
    log = LogInMemory(table)
    for number in range(12):
        for index, kind in enumerate(TYPES):
            log.send(f"sample/{kind.__name__}", sample(kind, random), 0.1 * (number + index), POSE, "ned")
    assert read(log.close(), tmp_path, table) == log.sent


def test_the_exact_time_of_validity_comes_back(tmp_path: Path) -> None:
    log = LogInMemory()
    t_s = 0.1 + 0.2  # not a whole number of nanoseconds
    log.send("components/pose/event", Event(severity=Severity.INFO, text=""), t_s, POSE)
    assert read(log.close(), tmp_path)[0].t_s == t_s


def test_numbers_that_are_no_numbers_come_back(tmp_path: Path) -> None:
    log = LogInMemory()
    log.send(
        "setpoint", Setpoint(action_id="null", velocity_ned_m_s=(1.0, math.inf, -math.inf), yaw_rad=math.nan), 1.0, POSE
    )
    log.send("components/pose/internal", InternalState(items={"a.b": [math.nan], "c": None}), 1.0, POSE)
    setpoint, internal = (envelope.payload for envelope in read(log.close(), tmp_path))
    assert setpoint.velocity_ned_m_s == (1.0, math.inf, -math.inf)
    assert setpoint.position_ned_m is None
    assert math.isnan(setpoint.yaw_rad)
    assert math.isnan(internal.items["a.b"][0])
    assert internal.items["c"] is None


def test_a_message_without_fields_comes_back(tmp_path: Path) -> None:
    table = TopicTable({"nothing": TopicRow(Nothing)})
    log = LogInMemory(table)
    log.send("nothing", Nothing(), 1.0, POSE)
    assert read(log.close(), tmp_path, table) == log.sent


def test_a_topic_is_one_channel_whoever_publishes_it(tmp_path: Path) -> None:
    log = LogInMemory()
    log.send("pose", POSE_MESSAGE, 0.5, POSE, "ned")
    log.send("pose", POSE_MESSAGE, 0.6, POSE, "local")
    log.send("pose", POSE_MESSAGE, 0.7, Source("pelican", "pose_standby", 7), "local")
    for boot in (1, 2, 1):
        log.send(
            "components/pose/event", Event(severity=Severity.INFO, text=str(boot)), 1.0, Source("pelican", "pose", boot)
        )
    data = log.close()
    assert read(data, tmp_path) == log.sent
    summary = make_reader(io.BytesIO(data)).get_summary()
    assert summary is not None
    assert len({channel.topic for channel in summary.channels.values()}) == len(summary.channels)
    path = tmp_path / "log.mcap"
    with LogReader(path) as reader:
        lives = {topic.topic: topic.lives for topic in summarize(reader, TopicTable(TOPICS)).topics}
    assert lives == {"frames": 1, "pelican/components/pose/event": 2, "pelican/pose": 2}


def test_what_its_row_leaves_out_is_not_recorded_and_what_has_no_row_is(tmp_path: Path) -> None:
    log = LogInMemory()
    log.send("camera/front", Image(camera="front", width=2, height=1, data=b"ab"), 1.0, POSE)
    log.send("surprise", Event(severity=Severity.INFO, text="new"), 1.0, POSE)
    assert [envelope.topic for envelope in read(log.close(), tmp_path)] == ["pelican/surprise"]
    assert log.recorder.unknown == ["pelican/surprise"]


def test_it_counts_what_it_recorded_by_topic() -> None:
    log = LogInMemory()
    log.send("components/a/event", Event(severity=Severity.INFO, text="one"), 1.0, POSE)
    log.send("components/a/event", Event(severity=Severity.INFO, text="two"), 1.5, HEIGHT)
    counted = log.recorder.statistics()["pelican/components/a/event"]
    assert counted.messages == 2
    assert counted.bytes > 200
    log.close()


def test_other_readers_find_every_checksum_and_index_right() -> None:
    data, sent = small_log()
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    shown = 1 + sum(envelope.topic == "pelican/pose" for envelope in sent)  # frames
    assert len(list(reader.iter_messages())) == len(sent) + shown
    streamed = list(StreamReader(io.BytesIO(data), validate_crcs=True).records)
    assert type(streamed[-1]).__name__ == "Footer"
    summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(sent) + shown
    assert [m.name for m in reader.iter_metadata()] == [RUN]


def test_foxglove_sees_poses_events_and_how_ned_hangs_under_the_map() -> None:
    data, _ = small_log()
    pose = objects(data, "pelican/pose")[1]
    assert pose["frame_id"] == "ned"
    assert pose["pose"]["position"] == {"x": 0.1, "y": 0.2, "z": -1.5}
    assert pose["pose"]["orientation"] == {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}
    assert pose["timestamp"]["nsec"] == 100_000_000
    event = objects(data, "pelican/components/pose/event")[0]
    assert (event["level"], event["message"], event["name"]) == (4, "working -> faulty: ValueError", "pose")
    first, second, *_ = objects(data, "frames")
    (transform,), (body,) = first["transforms"], second["transforms"]
    assert (body["parent_frame_id"], body["child_frame_id"]) == ("ned", "pelican/body")
    assert body["translation"] == {"x": 0.0, "y": 0.0, "z": -1.5}
    assert (transform["parent_frame_id"], transform["child_frame_id"]) == ("map", "ned")
    assert transform["rotation"]["x"] == transform["rotation"]["y"] == pytest.approx(math.sqrt(0.5))
    assert transform["rotation"]["w"] == transform["rotation"]["z"] == 0.0


def test_foxglove_sees_the_requested_path() -> None:
    (path,) = objects(flight_log(), "requested_path")
    assert [pose["position"]["x"] for pose in path["poses"]] == [north for north, _, _ in REQUESTED]
    _check_simple(PATH_SCHEMA, is_item=False)
    _check_simple(TRANSFORM_SCHEMA, is_item=False)


def test_foxglove_sees_images_and_places_on_earth() -> None:
    log = LogInMemory(TopicTable({"camera": TopicRow(Image)}))
    log.send("camera", Image(camera="front", width=2, height=1, data=b"ab"), 1.0, POSE)
    summary = VehicleSummary(
        t_s=1.0,
        mode="HOLD",
        is_armed=True,
        landed="in_air",
        battery_percent=80,
        position_m=(0.0, 0.0, 1.5),
        speed_m_s=0.0,
        heading_deg=0,
        is_pose_valid=True,
        has_pilot_control=False,
        is_autopilot_connected=True,
    )
    log.send("ci/vehicle", summary, 1.0, POSE)
    log.send("ci/vehicle", msgspec.structs.replace(summary, geo=(39.5, 2.625, 3.5)), 1.5, POSE)
    data = log.close()
    nowhere, here = objects(data, "pelican/ci/vehicle")
    assert "latitude" not in nowhere
    assert (here["latitude"], here["longitude"], here["altitude"]) == (39.5, 2.625, 3.5)
    (image,) = objects(data, "pelican/camera")
    assert {"format": "png", "frame_id": "front"}.items() <= image.items()
    assert base64.b64decode(image["data"]).startswith(b"\x89PNG")


@pytest.mark.parametrize("kind", TYPES, ids=lambda kind: str(kind.__name__))
def test_foxglove_can_read_the_schema(kind: type[Message]) -> None:
    name, text = PayloadEncoder(kind).schema
    assert name.startswith(("gloc3.", "foxglove."))
    _check_simple(json.loads(text), is_item=False)


def _check_simple(schema: dict[str, Any], *, is_item: bool) -> None:
    """What Foxglove's reader of JSON schemas takes, and nothing else."""
    if "oneOf" in schema:
        assert all(isinstance(option["const"], int) for option in schema["oneOf"])
    elif schema["type"] == "object":
        for child in schema["properties"].values():
            _check_simple(child, is_item=False)
    elif schema["type"] == "array":
        assert not is_item
        _check_simple(schema["items"], is_item=True)
    else:
        assert schema["type"] in SCALARS
        assert not (is_item and "contentEncoding" in schema)


def test_mavlink_frames_are_recorded_as_they_are(tmp_path: Path) -> None:
    log = LogInMemory()
    log.recorder.record_mavlink("radio", "in", b"\xfd\x00", 0.5)
    log.recorder.record_mavlink("radio", "out", b"\xfd\x01", 0.75)
    log.recorder.record_mavlink("radio", "in", b"\xfd\x02", 1.0)
    file = tmp_path / "log.mcap"
    file.write_bytes(log.close())
    with LogReader(file) as reader:
        assert [tuple(frame) for frame in reader.frames()] == [
            (0.5, "radio", "in", b"\xfd\x00"),
            (0.75, "radio", "out", b"\xfd\x01"),
            (1.0, "radio", "in", b"\xfd\x02"),
        ]


def test_metadata_and_attachments_come_back(tmp_path: Path) -> None:
    log = LogInMemory()
    log.recorder.write_metadata("mission", {"text": "mission: hop"})
    log.recorder.attach_file("platform.yaml", b"platform: pelican")
    file = tmp_path / "log.mcap"
    file.write_bytes(log.close())
    with LogReader(file) as reader:
        assert reader.metadata("mission") == {"text": "mission: hop"}
        assert reader.attachments == {"platform.yaml": b"platform: pelican"}
        assert reader.run["time"] == "virtual"
        assert reader.platform == "pelican"


def test_arrays_in_the_internal_state_become_lists_and_sets_have_an_order() -> None:
    items = {"covariance": np.eye(2), "names": {"b", "a", "c"}, "device": object(), "count": np.int64(3)}
    log = LogInMemory()
    log.send("components/pose/internal", InternalState(items=items), 1.0, POSE)
    (found,) = objects(log.close(), "pelican/components/pose/internal")
    assert found["items"] == {
        "covariance": [[1.0, 0.0], [0.0, 1.0]],
        "names": ["a", "b", "c"],
        "device": "<object>",
        "count": 3,
    }


def test_a_payload_that_cannot_be_written_leaves_the_reason(tmp_path: Path) -> None:
    log = LogInMemory()
    log.send("components/pose/internal", InternalState(items={"a": {(1, 2): "tuple as a key"}}), 1.0, POSE)
    log.send("components/pose/event", Event(severity=Severity.INFO, text="next"), 1.0, POSE)
    broken, event = read(log.close(), tmp_path)
    assert "InternalState" in broken.payload[PROBLEM]
    assert event.payload.text == "next"


def test_a_time_that_no_log_can_hold_is_counted() -> None:
    log = LogInMemory()
    event = log.send("components/pose/event", Event(severity=Severity.INFO, text=""), 1.0, POSE)
    for t_s in (math.nan, math.inf, 1e15, -1e15):
        log.recorder.record(msgspec.structs.replace(event, t_s=t_s))
    assert log.recorder.lost == 4
    log.close()


class FullDisk(io.BytesIO):
    """Takes the beginning of a log, then nothing more."""

    def __init__(self, size: int = 3000) -> None:
        super().__init__()
        self._size = size

    def write(self, data: Any) -> int:
        if self.tell() > self._size:
            raise OSError(28, "No space left on device")
        return super().write(data)


def test_a_full_disk_ends_the_log_and_not_the_flight() -> None:
    log = LogInMemory()
    recorder = log.recorder = Recorder(FullDisk(), Clock(log.loop), TopicTable(TOPICS), {})
    pose = Pose(position_ned_m=(0.0, 0.0, 0.0), velocity_ned_m_s=(0.0, 0.0, 0.0), ned_from_frd=(1.0, 0.0, 0.0, 0.0))
    for index in range(40):
        log.send("pose", pose, 0.25 * index, POSE)
    assert recorder.problem == "the log cannot be written: No space left on device"
    assert recorder.lost > 0
    recorder.write_metadata("late", {})
    log.close()


@pytest.mark.parametrize("size", [600, 1500, 3000])
def test_topics_that_begin_when_the_disk_is_full_already_harm_nobody(
    size: int, caplog: pytest.LogCaptureFixture
) -> None:
    log = LogInMemory()
    recorder = log.recorder = Recorder(FullDisk(size), Clock(log.loop), TopicTable(TOPICS), {})
    exchange = LocalExchange()
    recorder.attach(exchange)
    for index in range(20):
        event = Event(severity=Severity.INFO, text="here")
        exchange.publish(log.envelope(f"components/pose{index}/event", event, 0.1 * index, POSE))
        recorder.record_mavlink(f"station{index}", "in", b"frame", 0.1 * index)
    recorder.flush(10.0)
    assert recorder.problem == "the log cannot be written: No space left on device"
    assert recorder.lost > 0
    log.close()
    assert not caplog.records, "no subscriber of the exchanger has failed"


def test_a_file_that_cannot_be_written_is_said_at_once(tmp_path: Path) -> None:
    loop = VirtualLoop()
    with pytest.raises(Gloc3Error, match="cannot write the log"):
        Recorder(tmp_path / "no" / "log.mcap", Clock(loop), TopicTable(), {})
    loop.close()


def test_attached_to_an_exchanger_it_records_everything_and_flushes_by_itself() -> None:
    log = LogInMemory()
    exchange = LocalExchange()
    log.recorder.attach(exchange, log.loop)
    event = log.envelope("components/pose/event", Event(severity=Severity.INFO, text="here"), 0.1, POSE)
    exchange.publish(event)
    before = len(log.stream.getvalue())
    log.loop.run_until_complete(asyncio.sleep(0.3))
    assert len(log.stream.getvalue()) > before
    data = log.close()
    exchange.publish(event)
    assert [found["text"] for found in objects(data, "pelican/components/pose/event")] == ["here"]
    assert log.stream.getvalue() == data
