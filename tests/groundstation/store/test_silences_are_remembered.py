"""A station that is restarted while a vehicle is out of contact knows until when, and raises the alarm at that time."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

from msgspec.structs import replace
from tests.groundstation.scripted_platform import VEHICLE

from gloc3.clock import VirtualLoop
from gloc3.exchange import LocalExchange, Publisher
from gloc3.exchange.acoustic import AcousticSummary
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import Health, MissionSummary
from gloc3.messages.topics import TopicTable
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.alerts import causes
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.store.kept_state import SilenceFile

DIVE = MissionSummary(name="m", digest="d", state="running", silence="dive", silent_until_s=600.0)


class Life:
    """One life of a station, and what it hears of the platform."""

    def __init__(self, file: Path) -> None:
        self.loop = asyncio.get_running_loop()
        self.exchange = LocalExchange(TopicTable.installed())
        self.station = Station(self.exchange, self.loop, "255", 1)
        self.file = SilenceFile(file, self.station, self.loop)
        self._publisher = Publisher(self.exchange, "auv", "command_server", 7)

    def receive(self, mission: MissionSummary) -> None:
        self._publisher.publish("auv/ci/vehicle", replace(VEHICLE, is_armed=True), self.loop.time())
        self._publisher.publish("auv/ci/mission", mission, self.loop.time())

    def shown(self) -> str:
        """How the silence is shown; empty for a platform that is not known."""
        known = self.station.fleet.get("auv")
        return "" if known is None else wording.silence(known, self.loop.time())

    def alarms(self) -> list[tuple[Severity, str]]:
        return [(one.severity, one.text) for one in causes(self.station.fleet, self.loop.time())]

    def reported(self) -> list[str]:
        return [event.text for event in self.station.fleet.events]

    def end(self) -> None:
        self.file.close()
        self.station.close()


def played(steps: Callable[[], Awaitable[None]]) -> None:
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        runner.run(steps())  # type: ignore[arg-type]


def test_the_next_life_of_a_station_shows_the_silence_the_alarm_and_the_contact(tmp_path: Path) -> None:
    async def steps() -> None:
        first = Life(tmp_path / "silences.json")
        first.receive(DIVE)
        await asyncio.sleep(20.0)
        words = first.shown()
        assert words.startswith("silent as planned (dive), due 00:10:00")
        first.end()
        second = Life(tmp_path / "silences.json")
        assert second.shown() == words
        assert "was silent as planned (dive), due 00:10:00 UTC" in second.reported()
        await asyncio.sleep(300.0)
        assert second.alarms() == []
        await asyncio.sleep(300.0)
        assert second.shown().startswith("OVERDUE by 20 s (dive)")
        assert [text.split(":")[0] for _, text in second.alarms()] == ["overdue"]
        second.receive(replace(DIVE, silence="", silent_until_s=0.0))
        assert second.reported()[-1] == "is heard again after 620 s of silence, 20 s overdue"
        assert second.alarms() == []
        second.end()
        assert Life(tmp_path / "silences.json").shown() == "", "a silence that has ended is not remembered"

    played(steps)


def test_a_file_that_cannot_be_read_is_none(tmp_path: Path) -> None:
    async def steps() -> None:
        (tmp_path / "silences.json").write_text("{")
        life = Life(tmp_path / "silences.json")
        assert life.shown() == ""
        life.end()

    played(steps)


def test_a_platform_that_is_heard_by_sound_alone_is_in_view_without_an_alarm_or_a_restart(tmp_path: Path) -> None:
    async def steps() -> None:
        life = Life(tmp_path / "silences.json")
        summary = AcousticSummary(
            t_s=9.0,
            position_m=(1.0, 2.0, -8.0),
            is_pose_valid=True,
            is_armed=True,
            heading_deg=0,
            speed_m_s=0.5,
            battery_percent=80,
            state="running",
            policy="",
            health=Health.WORKING,
            doing=-1,
            mission=0,
            worst=Severity.INFO,
        )
        Publisher(life.exchange, "auv", "acoustic", 3).publish("auv/acoustic", summary, 0.0)
        assert "acoustic 0 s ago: x 1.0  y 2.0  h -8.0 m, running, battery 80 %" in life.shown()
        idle = replace(summary, state="", battery_percent=-1)
        Publisher(life.exchange, "auv", "acoustic", 3).publish("auv/acoustic", idle, 0.0)
        assert life.shown().endswith("h -8.0 m, no mission")
        assert life.alarms() == []
        await asyncio.sleep(60.0)
        assert life.alarms() == []
        life.receive(DIVE)
        assert life.reported() == ["is heard by acoustic modem only", "is heard"]
        life.end()

    played(steps)
