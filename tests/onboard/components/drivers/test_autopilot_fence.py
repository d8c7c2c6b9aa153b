"""The autopilot's own geofence follows that of the loaded mission: uploaded, read back, tried again."""

from collections.abc import Sequence

import pytest

from gloc3.component.ports import Actuation, inbox_of
from gloc3.mavlink.codec import Encoder, Parser
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.services.mission_client import MissionClient, Transfer
from gloc3.mavlink.services.mission_server import MissionServer
from gloc3.mavlink.services.plan import PlanType
from gloc3.messages.envelope import Envelope, Source
from gloc3.messages.vehicle import AutopilotState, FenceProgress, FenceState, GeoArea, GeoFence
from gloc3.mission.formats.items import FenceArea
from gloc3_onboard.autopilot.plan_upload import FenceUpload, fence_items
from gloc3_onboard.components.drivers.autopilot_fence import ON_S, RETRY_S, AutopilotFence, SendFence
from gloc3_onboard.sensors.devices import CommandAnswer

COMPANION, AUTOPILOT = Address(1, 191), Address(1, 1)
SQUARE = [(47.0, 8.0), (47.001, 8.0), (47.001, 8.001), (47.0, 8.001)]
FENCE = GeoFence(digest="abc", areas=[GeoArea(True, SQUARE), GeoArea(False, [], (47.0005, 8.0005), 5.3)])
AREAS = (
    FenceArea(is_inclusion=True, polygon=tuple(SQUARE)),
    FenceArea(is_inclusion=False, center=(47.0005, 8.0005), radius_m=5.3),
)


class Control:
    """Answers what the test says."""

    def __init__(self) -> None:
        self.fence_problem = ""
        self.is_armed = False
        self.sent: list[tuple[FenceArea, ...]] = []
        self.says: CommandAnswer | None = None

    def command_fence(self, areas: Sequence[FenceArea]) -> int:
        self.sent.append(tuple(areas))
        return len(self.sent)

    def answer(self, ticket: int) -> CommandAnswer | None:
        return self.says

    def state(self) -> AutopilotState:
        return AutopilotState(is_connected=True, is_armed=self.is_armed)


def cycle(driver: AutopilotFence, now_s: float, fence: GeoFence | None = None) -> list[FenceState]:
    inbox = inbox_of()
    if fence is not None:
        inbox = inbox_of(geofence=Envelope("p/f", Source("p", "c", 1), 0, now_s, "", "GeoFence", fence))
    states = []
    for result in driver.work(now_s, inbox):
        if isinstance(result, Actuation):
            assert isinstance(result.write, SendFence)
            driver.actuate(result.write)
        elif isinstance(result, FenceState):
            states.append(result)
    return states


def test_a_fence_is_sent_once_and_confirmed_when_it_was_read_back() -> None:
    control = Control()
    driver = AutopilotFence(control)
    assert cycle(driver, 0.0, FENCE)[0].progress is FenceProgress.UPLOADING
    cycle(driver, 0.2, FENCE)
    assert control.sent == [AREAS]
    control.says = CommandAnswer(True, "")
    assert cycle(driver, 0.4, FENCE)[0] == FenceState(digest="abc", progress=FenceProgress.CONFIRMED)


def test_a_fence_that_is_refused_is_told_with_the_reason_and_sent_again() -> None:
    control = Control()
    driver = AutopilotFence(control)
    cycle(driver, 0.0, FENCE)
    control.says = CommandAnswer(False, "no room")
    assert cycle(driver, 0.2, FENCE)[0].reason == "no room"
    cycle(driver, 0.2 + RETRY_S, FENCE)
    assert len(control.sent) == 2


def test_a_fence_that_was_never_ours_is_left_alone() -> None:
    control = Control()
    driver = AutopilotFence(control)
    cycle(driver, 0.0, GeoFence(digest=""))
    cycle(driver, 1.0, GeoFence(digest="indoors"))
    assert control.sent == []


def test_our_fence_stays_without_a_mission_and_goes_with_a_mission_that_has_none() -> None:
    control = Control()
    driver = AutopilotFence(control)
    cycle(driver, 0.0, FENCE)
    control.says = CommandAnswer(True, "")
    cycle(driver, 0.2, FENCE)
    cycle(driver, 1.0, GeoFence(digest=""))
    assert control.sent == [AREAS]
    cycle(driver, 2.0, FENCE)
    assert control.sent == [AREAS, AREAS], "a mission that comes again does not trust what was held before"
    cycle(driver, 2.2, FENCE)
    for now_s in (3.0, 3.2, 3.4):
        cycle(driver, now_s, GeoFence(digest="indoors"))
    cycle(driver, 4.0, GeoFence(digest="indoors too"))
    assert control.sent == [AREAS, AREAS, ()]


def test_a_fence_that_the_autopilot_reports_as_off_is_not_confirmed() -> None:
    control = Control()
    control.fence_problem = "it is off"
    driver = AutopilotFence(control)
    cycle(driver, 0.0, FENCE)
    control.says = CommandAnswer(True, "")
    assert cycle(driver, 0.2, FENCE) == []
    assert cycle(driver, 0.2 + ON_S - 0.1, FENCE)[0].progress is FenceProgress.UPLOADING
    (state,) = cycle(driver, 0.2 + ON_S, FENCE)
    assert (state.progress, state.reason) == (FenceProgress.FAILED, "it is off")
    cycle(driver, RETRY_S, FENCE)
    control.fence_problem = ""
    assert cycle(driver, RETRY_S + 0.2, FENCE)[0].progress is FenceProgress.CONFIRMED


@pytest.mark.parametrize("is_armed", [False, True])
def test_a_fence_that_is_off_later_is_sent_again_unless_a_pilot_flies(is_armed: bool) -> None:
    control = Control()
    driver = AutopilotFence(control)
    cycle(driver, 0.0, FENCE)
    control.says = CommandAnswer(True, "")
    cycle(driver, 0.2, FENCE)
    control.fence_problem, control.is_armed = "it is off", is_armed
    cycle(driver, 10.0, FENCE)
    cycle(driver, 10.2, FENCE)
    assert len(control.sent) == (1 if is_armed else 2)


def on_the_wire(message: MavlinkMessage, sender: Address) -> MavlinkMessage:
    """What arrives of it: numbers in single precision."""
    (frame,) = Parser().receive(Encoder(*sender).encode(message))
    arrived = frame.decode()
    assert arrived is not None
    return arrived


def exchange(
    client: MissionClient, server: MissionServer, upload: FenceUpload, steps: int = 400
) -> list[CommandAnswer]:
    answers = []
    for step in range(steps):
        now_s = 0.01 * step
        for message in client.outgoing():
            server.receive(on_the_wire(message, COMPANION), COMPANION, now_s)
        for message in server.outgoing():
            client.receive(on_the_wire(message, AUTOPILOT), AUTOPILOT, now_s)
        client.tick(now_s)
        server.tick(now_s)
        for event in client.events():
            ended = upload.received(event, now_s) if isinstance(event, Transfer) else None
            if ended is not None:
                answers.append(ended[1])
    return answers


def test_the_fence_is_uploaded_over_the_mission_protocol_and_compared() -> None:
    client, server = MissionClient(COMPANION), MissionServer(AUTOPILOT)
    upload = FenceUpload(client)
    upload.begin(1, AREAS, AUTOPILOT, 0.0)
    assert exchange(client, server, upload) == [CommandAnswer(True, "")]
    assert [item.command for item in server.plans[PlanType.FENCE]] == [5001, 5001, 5001, 5001, 5004]


def test_a_circle_and_a_polygon_keep_their_places_to_a_centimetre() -> None:
    items = fence_items(AREAS)
    assert (items[0].x, items[0].y, items[0].param1) == (470000000, 80000000, 4.0)
    assert (items[4].x, items[4].y) == (470005000, 80005000)
    assert items[4].param1 == pytest.approx(5.3)
