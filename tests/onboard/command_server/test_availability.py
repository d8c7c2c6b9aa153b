"""Which capabilities can be used: what they need has to be there, working, and speaking."""

import msgspec
import pytest
from tests.onboard.messages import at, pose

from gloc3.component.lci import State
from gloc3.messages.envelope import ComponentStatus, Kind
from gloc3.messages.standard_topics import POSE_LOST_S
from gloc3.platform.reader import load_platform
from gloc3_onboard.command_server.component_book import ComponentBook
from gloc3_onboard.command_server.observing import Availability
from gloc3_onboard.command_server.vehicle_state import VehicleState

NAME = "record_images"


class Desk:
    """A platform whose pictures need what a test says, all of it well until the test says otherwise."""

    def __init__(self, *needs: str) -> None:
        platform = load_platform("pelican_rtk")
        row = msgspec.structs.replace(platform.capabilities[NAME], needs=needs)
        self.platform = msgspec.structs.replace(platform, capabilities={**platform.capabilities, NAME: row})
        self.book = ComponentBook(self.platform.components)
        self.availability = Availability(self.platform)
        self.snapshot = VehicleState(self.platform, None)
        self.now_s = 0.0
        for component in self.platform.components:
            self.report(component.name)
        self.now_s = 1.0

    def report(self, name: str, state: State | None = State.WORKING, *silent: str) -> None:
        status = ComponentStatus(name=name, kind=Kind.SAMPLER, state=state, silent=list(silent))
        self.book.receive(status, self.now_s)

    def missing(self) -> tuple[str, ...]:
        return self.availability.missing(self.book, self.snapshot, self.now_s).get(NAME, ())


@pytest.mark.parametrize("need", ["camera/ground", "ground_camera", "height"])
def test_the_component_behind_a_need_must_work(need: str) -> None:
    desk = Desk(need)
    assert desk.missing() == ()
    desk.report("height" if need == "height" else "ground_camera", State.STANDBY)
    assert desk.missing() == (need,)


def test_a_topic_that_is_needed_must_not_be_silent_although_its_component_works() -> None:
    desk = Desk("camera/ground")
    desk.report("ground_camera", State.WORKING, "camera/ground")
    assert desk.missing() == ("camera/ground",)
    desk.report("ground_camera")
    assert desk.missing() == ()


def test_the_silence_of_other_topics_of_that_component_is_no_matter() -> None:
    desk = Desk("camera/ground")
    desk.report("ground_camera", State.WORKING, "camera/extra")
    desk.report("height", State.WORKING, "height")
    assert desk.missing() == ()


def test_a_late_pose_is_waited_for_and_a_lost_one_is_not() -> None:
    desk = Desk("pose")
    desk.snapshot.update_pose(at(0.0, pose(0.0, 0.0, 0.0)))
    desk.now_s = 0.9 * POSE_LOST_S
    assert desk.missing() == ()
    desk.now_s = 1.1 * POSE_LOST_S
    assert desk.missing() == ("pose",)


def test_without_a_young_pose_what_needs_it_is_not_to_be_had() -> None:
    assert Desk("pose", "autopilot").missing() == ("pose", "autopilot")
