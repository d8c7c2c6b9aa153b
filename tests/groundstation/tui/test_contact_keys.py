"""The keys for vehicles out of contact: missions that wait, and the onboard computer's logs."""

from hashlib import sha256
from pathlib import Path
from random import Random

import pytest
from tests.groundstation.services_scene import NAME, ServicesScene, services_scene
from tests.groundstation.station_scene import Scene, scene
from tests.node_runner import NodeRunner

from gloc3.component.workers import ImmediateExecutor
from gloc3.exchange import Publisher
from gloc3.mavlink.message import Address
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.services.files.ftp_files import FolderFiles
from gloc3.mavlink.services.files.ftp_server import FtpServer
from gloc3.mavlink.transport.memory import PERFECT, Conditions
from gloc3.messages.command_interface import AboutLogs, CiRequest, LoadMission
from gloc3.messages.envelope import Envelope
from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.tui.dialogues.questions import YesNoQuestion
from gloc3_onboard.command_server.log_shelf import LogStore

pytestmark = pytest.mark.sockets
COMPANION = Address(1, 191)
SLOW = Conditions(latency_s=0.002, bandwidth_bit_s=2_000_000)


def shown(here: Scene, text: str) -> bool:
    return any(text in event.text for event in here.station.fleet.events)


async def test_u_queues_a_mission_while_nothing_is_heard_delete_takes_it_back_and_contact_sends_it() -> None:
    async with scene() as here:
        here.platform.speak()
        await here.go("3")
        await here.until("title", "link ok")
        await here.wait(lambda: shown(here, "'cargo hold' is loaded and read back"))  # the one at hand, at the begin
        now_s, later_s = here.station.now_s, 60.0
        here.station.now_s = lambda: now_s() + later_s  # type: ignore[misc]
        await here.until("title", "SILENT")
        await here.press("u")
        await here.until("position", "'cargo hold' is queued for contact, delete withdraws it")
        await here.until("alert", "no messages from it any more")
        await here.press("x")
        await here.wait(lambda: here.shown("alert") == "")
        await here.until("position", "queued for contact")
        await here.press("delete")
        await here.wait(lambda: shown(here, "'cargo hold' is withdrawn: it is not sent"))
        assert "waits" not in here.shown("position")
        await here.press("u")
        await here.until("position", "queued for contact")
        assert len(here.requested(LoadMission)) == 1
        later_s = 0.0
        here.platform.speak()
        await here.wait(lambda: len(here.requested(LoadMission)) == 2)
        await here.wait(lambda: "queued for contact" not in here.shown("position"))
    assert len(here.requested(LoadMission)) == 2


class OnboardComputer:
    """The onboard computer of the scripted vehicle: its logs, by MAVLink FTP and over its command interface."""

    def __init__(self, here: ServicesScene, folder: Path) -> None:
        loop = here.platform.loop
        self._log_store = LogStore(folder / "logs", set, lambda: None, ImmediateExecutor())
        self._publisher, self._loop = Publisher(here.exchange, NAME, "command_server", 1), loop
        here.exchange.subscribe(f"{NAME}/ci/request", self._take)
        server = FtpServer(COMPANION, FolderFiles(folder))
        self.runner = NodeRunner(MavlinkComponent(COMPANION, [server]), loop, here.memory.b.send)
        autopilot = here.memory.b.on_data
        assert autopilot is not None

        def handle(data: bytes) -> None:
            autopilot(data)
            self.runner.on_data(data)

        here.memory.b.on_data = handle

    def _take(self, envelope: Envelope[CiRequest]) -> None:
        if isinstance(envelope.payload.body, AboutLogs):
            reply = self._log_store.handle(envelope.payload)
            for reported in [*([] if reply is None else [reply]), *self._log_store.collect()]:
                self._publisher.publish(f"{NAME}/ci/reply", reported, self._loop.time())


async def test_o_fetches_the_onboard_computers_logs_after_a_question_and_goes_on_where_it_was_cancelled(
    tmp_path: Path,
) -> None:
    onboard, downloads, content = tmp_path / "vehicle", tmp_path / "here", Random(3).randbytes(150_000)
    (onboard / "logs").mkdir(parents=True)
    downloads.mkdir()
    there, log = onboard / "logs" / "log.mcap", downloads / NAME / "log.mcap"
    there.write_bytes(content)
    async with services_scene(downloads=downloads, conditions=SLOW) as here:
        computer = OnboardComputer(here, onboard)
        await here.tab("Logs")
        await here.press("o")
        await here.shows(YesNoQuestion)
        await here.press("n")
        await here.wait(lambda: not isinstance(here.app.screen, YesNoQuestion))
        assert not here.services.vehicle(NAME).jobs.running
        await here.press("o")
        await here.shows(YesNoQuestion)
        await here.press("y")
        await here.until("job", "fetching log.mcap")
        await here.until("job", "150 kB")
        jobs = here.services.vehicle(NAME).jobs.running
        await here.wait(lambda: ServiceKind.LOGS not in jobs or (jobs[ServiceKind.LOGS].fraction or 0.0) > 0.2)
        await here.press("escape")
        await here.until("job", "✗ fetching the onboard computer's logs: cancelled")
        (part,) = log.parent.iterdir()
        begun = part.stat().st_size
        assert 0 < begun < len(content)
        assert content.startswith(part.read_bytes())
        assert there.exists()
        here.memory.set_conditions(PERFECT)
        await here.press("o")
        await here.shows(YesNoQuestion)
        await here.press("y")
        await here.until("job", "1 log of the onboard computer: in")
        assert "digests equal, deleted onboard" in here.shown("job").replace("\n   ", " ")
        computer.runner.stop()
    assert sha256(log.read_bytes()).digest() == sha256(content).digest()
    assert list(log.parent.iterdir()) == [log]
    assert not there.exists()
