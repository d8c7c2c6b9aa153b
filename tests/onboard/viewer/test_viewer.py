"""The viewer: samples of what somebody looks at, at the rate that is wanted, for as long as the lease is renewed."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gloc3.clock import Clock, VirtualLoop
from gloc3.component.deployment import ComponentRow
from gloc3.component.lci import State
from gloc3.component.test_bench import PLATFORM, Bench
from gloc3.exchange import Publisher
from gloc3.log.reader import LogReader
from gloc3.log.record import Recorder
from gloc3.messages.envelope import Envelope, Source
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import HeightAboveGround, Image, ObstacleScan
from gloc3.messages.watch import LEASE_S, Preview, Sample, TopicActivity, Want, unpack
from gloc3.messages.wire import type_name
from gloc3.platform.reader import load_platform
from gloc3_onboard.process.taps import ExchangeTaps
from gloc3_onboard.viewer.catalogue import Catalogue
from gloc3_onboard.viewer.leases import MOST_STATIONS, Leases
from gloc3_onboard.viewer.viewer import RateMeter, Viewer, fit

TABLE = TopicTable.installed()
PORTS: dict[str, str | list[str]] = {
    "sample": "watch/sample/{key}",
    "large": "watch/large/{key}",
    "activity": "watch/activity",
}


class Scene:
    """A viewer, and somebody who publishes heights 20 times a second."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        taps = ExchangeTaps(bench.exchange, bench.loop, PLATFORM)
        catalogue = Catalogue(load_platform("pelican_rtk"), TABLE)
        row = ComponentRow(name="viewer", class_name="x:Viewer", rate_hz=5.0, ports=PORTS)
        self.host = bench.host(row, lambda: Viewer(taps, catalogue))
        self.publisher = Publisher(bench.exchange, PLATFORM, "somebody", 5)
        self.seen: list[tuple[float, Envelope[Any]]] = []
        bench.exchange.subscribe(f"{PLATFORM}/watch/**", lambda e: self.seen.append((bench.loop.time(), e)))
        self.bench.run(0.1)

    def request(self, *wants: Want, station: str = "255", is_listing: bool = False) -> Any:
        arguments = {
            "station": station,
            "wants": [[w.topic, w.rate_hz, w.width, w.height, w.quality] for w in wants],
            "is_listing": is_listing,
        }
        return self.bench.call("viewer", "watch", **arguments)

    def publish(self, topic: str, period_s: float, message: Any) -> None:
        def report() -> None:
            self.publisher.publish(f"{PLATFORM}/{topic}", message, self.bench.loop.time())
            self.bench.loop.call_later(period_s, report)

        self.bench.loop.call_soon(report)

    def fly(self, period_s: float = 0.05) -> None:
        self.publish("height", period_s, HeightAboveGround(height_m=2.5, is_valid=True))

    def messages(self) -> list[Any]:
        return [unpack(e, TABLE.types).payload if isinstance(e.payload, Sample) else e.payload for _, e in self.seen]


@pytest.fixture
def scene() -> Iterator[Scene]:
    with Bench(topics=TABLE) as bench:
        yield Scene(bench)


def test_a_topic_is_sampled_at_the_rate_that_is_wanted_and_the_sample_is_what_was_published(scene: Scene) -> None:
    scene.fly()
    assert scene.request(Want("height", 2.0)).is_accepted
    scene.bench.run(5.0)
    assert 9 <= len(scene.seen) <= 12
    t_s, envelope = scene.seen[-1]
    assert envelope.topic == f"{PLATFORM}/watch/sample/height"
    assert t_s - envelope.t_s <= 0.11
    read = unpack(envelope, TABLE.types)
    assert read.topic == f"{PLATFORM}/height"
    assert read.payload == HeightAboveGround(height_m=2.5, is_valid=True)
    assert envelope.payload.rate_hz == pytest.approx(20.0, abs=1.0)


def test_a_fast_topic_is_shown_up_to_ten_times_a_second(scene: Scene) -> None:
    scene.fly(0.01)
    scene.request(Want("height", 20.0))
    scene.bench.run(5.0)
    assert 45 <= len(scene.seen) <= 55


def test_a_topic_that_speaks_once_is_shown_once_and_its_last_word_is_not_lost(scene: Scene) -> None:
    scene.request(Want("height", 0.5))
    scene.bench.run(1.0)
    for height_m in (1.0, 2.0, 3.0):
        scene.bench.send("height", HeightAboveGround(height_m=height_m, is_valid=True))
        scene.bench.run(0.1)
    scene.bench.run(5.0)
    assert [message.height_m for message in scene.messages()] == [1.0, 3.0]


def test_nothing_is_sent_when_the_lease_ends_or_nobody_looks_any_more(scene: Scene) -> None:
    scene.fly()
    scene.request(Want("height", 5.0))
    scene.bench.run(LEASE_S + 20.0)
    assert scene.seen[-1][0] <= LEASE_S + 0.4
    scene.seen.clear()
    scene.request(Want("height", 5.0))
    scene.bench.run(2.0)
    scene.request()
    reported = len(scene.seen)
    assert reported > 5
    scene.bench.run(5.0)
    assert len(scene.seen) == reported


def test_an_idle_viewer_listens_to_nothing(scene: Scene) -> None:
    def listeners() -> int:
        return len(scene.bench.exchange._subscribers)

    before = listeners()
    scene.request(Want("height"), Want("pose"), is_listing=True)
    scene.bench.run(0.1)
    assert listeners() > before + 30
    scene.request()
    scene.bench.run(0.1)
    assert listeners() == before


def test_a_topic_that_is_not_there_is_refused_with_the_nearest_and_does_not_harm_the_others(scene: Scene) -> None:
    scene.fly()
    reply = scene.request(Want("hight"), Want("height"))
    assert reply.is_accepted
    assert reply.result["refused"] == {"hight": "there is no topic 'hight'; did you mean 'height'?"}
    scene.bench.run(2.0)
    assert scene.seen
    reply = scene.request(Want("hight"))
    assert not reply.is_accepted
    assert "did you mean 'height'?" in reply.reason
    reported = len(scene.seen)
    scene.bench.run(2.0)
    assert len(scene.seen) == reported, "what is refused takes the place of what was wanted before"


@pytest.mark.parametrize("topic", ["watch/sample/height", "watch/activity", "components/nobody/status", ""])
def test_neither_the_viewers_own_topics_nor_those_of_nobody_can_be_looked_at(scene: Scene, topic: str) -> None:
    assert not scene.request(Want(topic)).is_accepted


def test_the_internal_state_and_the_events_of_a_component_can_be_looked_at(scene: Scene) -> None:
    reply = scene.request(Want("components/pose/internal"), Want("components/pose/event"), Want("sim/truth"))
    assert reply.is_accepted
    assert reply.result["refused"] == {}


def test_an_image_is_made_small_and_keeps_its_proportions(scene: Scene) -> None:
    image = Image(camera="front", width=640, height=240, data=bytes(range(256)) * 600)
    scene.publish("camera/ground", 0.5, image)
    scene.request(Want("camera/ground", 1.0, 64, 48, 40))
    scene.bench.run(3.0)
    assert 2 <= len(scene.seen) <= 4
    assert all(e.topic == f"{PLATFORM}/watch/large/camera/ground" for _, e in scene.seen)
    assert scene.seen[0][1].payload.stations == ("255",)
    preview = scene.messages()[-1]
    assert isinstance(preview, Preview)
    assert (preview.width, preview.height) == (64, 24)
    assert (preview.full_width, preview.full_height) == (640, 240)
    assert 20 < len(preview.data) < 1500


def test_an_image_without_a_picture_says_why(scene: Scene) -> None:
    image = Image(camera="front", width=640, height=480, data=b"", is_valid=False, reason="no frame for 1.0 s")
    scene.publish("camera/ground", 0.5, image)
    scene.request(Want("camera/ground"))
    scene.bench.run(1.0)
    preview = scene.messages()[-1]
    assert not preview.is_valid
    assert preview.reason == "no frame for 1.0 s"
    assert preview.data == b""


def test_a_scan_of_a_recorded_flight_is_shown_whole(scene: Scene, tmp_path: Path) -> None:
    loop = VirtualLoop()
    recorder = Recorder(tmp_path / "log.mcap", Clock(loop), TABLE, {})
    points = [(5.0 * math.cos(0.0175 * n), 8.0 * math.sin(0.0175 * n)) for n in range(360)]
    name = type_name(ObstacleScan)
    for number in range(3):
        scan = ObstacleScan(points_ne_m=points[number:], height_m=1.5)
        recorder.record(Envelope("x/obstacles", Source("x", "laser", 1), number, float(number), "ned", name, scan))
    recorder.close()
    loop.close()
    reader = LogReader(tmp_path / "log.mcap", TABLE.types)
    recorded = [entry.envelope.payload for entry in reader.entries("obstacles")]
    reader.close()
    scene.request(Want("obstacles", 5.0))
    scene.bench.run(0.1)
    for scan in recorded:
        scene.bench.send("obstacles", scan)
        scene.bench.run(0.5)
    assert scene.messages() == recorded
    assert len(recorded[0].points_ne_m) == 360
    assert {e.topic for _, e in scene.seen} == {f"{PLATFORM}/watch/large/obstacles"}


def test_the_list_tells_how_every_topic_speaks_while_somebody_looks_at_it(scene: Scene) -> None:
    listed = scene.bench.call("viewer", "topics").result["topics"]
    names = [name for name, *_ in listed]
    assert {"pose", "camera/ground", "setpoint_wanted/hold", "components/limiter/internal"} <= set(names)
    assert not any(name.startswith("watch/") for name in names)
    scene.fly()
    scene.request(is_listing=True)
    scene.bench.run(4.0)
    activity = [e.payload for _, e in scene.seen if isinstance(e.payload, TopicActivity)]
    assert 3 <= len(activity) <= 4
    index = names.index("height")
    assert activity[-1].rates[index] == pytest.approx(200, abs=10)
    assert activity[-1].ages[index] == 0
    assert activity[-1].ages[names.index("pose")] == -1


def test_two_stations_get_what_the_more_demanding_one_wants_and_one_that_leaves_takes_nothing_from_the_other() -> None:
    leases = Leases()
    leases.grant("255", [Want("pose", 1.0), Want("camera/front", 1.0, 64, 48)], 0.0)
    leases.grant("254", [Want("camera/front", 0.5, 128, 96)], 1.0)
    both = leases.demands()["camera/front"]
    assert (both.rate_hz, both.width, both.height, both.stations) == (1.0, 128, 96, ("255", "254"))
    leases.expire(LEASE_S)
    assert list(leases.demands()) == ["camera/front"]
    assert leases.demands()["camera/front"].stations == ("254",)
    leases.grant("254", [], 9.0)
    assert leases.demands() == {}
    assert leases.until_s == float("inf")


def test_what_is_wanted_is_brought_back_to_what_can_be_served() -> None:
    leases = Leases()
    leases.grant("255", [Want("a", 0.0, -5, 0, 0), Want("b", 1e9, 10**9, 10**9, 10**9)], 0.0)
    least, most = leases.demands()["a"], leases.demands()["b"]
    assert least[:4] == (0.05, 8, 8, 1)
    assert most[:4] == (20.0, 640, 480, 100)


def test_more_stations_than_can_be_served_take_turns() -> None:
    leases = Leases()
    for number in range(MOST_STATIONS + 1):
        leases.grant(str(number), [Want(f"topic{number}")], float(number))
    assert list(leases.demands()) == [f"topic{number}" for number in range(1, MOST_STATIONS + 1)]


def test_a_viewer_that_was_stopped_begins_anew(scene: Scene) -> None:
    scene.fly()
    scene.request(Want("height", 5.0))
    scene.bench.run(1.0)
    scene.bench.command("viewer", "stop")
    reported = len(scene.seen)
    scene.bench.run(1.0)
    scene.bench.command("viewer", "start")
    scene.bench.run(1.0)
    assert len(scene.seen) == reported
    assert scene.host.state is State.WORKING


def test_a_picture_is_fitted_and_never_made_larger() -> None:
    assert fit((640, 480), (64, 48)) == (64, 48)
    assert fit((480, 640), (64, 48)) == (36, 48)
    assert fit((32, 20), (64, 48)) == (32, 20)
    assert fit((5000, 1), (64, 48)) == (64, 1)
    assert fit((0, 5), (64, 48)) == (0, 0)


def test_a_rate_is_that_of_the_last_seconds() -> None:
    meter, count = RateMeter(0.0), 0
    for step in range(1, 201):
        now_s = step * 0.1
        count += 1 if now_s <= 10.0 else 0
        rate_hz = meter.rate_hz(count, now_s)
        if now_s == pytest.approx(9.0):
            assert rate_hz == pytest.approx(10.0, abs=0.3)
    assert rate_hz == 0.0
