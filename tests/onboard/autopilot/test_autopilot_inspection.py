"""What is read of an autopilot before a start: version, time of day, parameters; anew when asked, and never for ever."""

from typing import Any

import pytest

from gloc3.mavlink.codec import Encoder, Parser, message
from gloc3.mavlink.message import Address
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import MavCommandClient
from gloc3.mavlink.services.command_server import MavCommandServer
from gloc3.mavlink.services.mission_client import MissionClient, Transfer
from gloc3.mavlink.services.mission_server import MissionServer
from gloc3.mavlink.services.parameter import ParameterEncoding, ParameterType, parameter
from gloc3.mavlink.services.parameter_server import ParameterServer
from gloc3.mavlink.services.plan import PlanItem, PlanType
from gloc3.mavlink.services.version import ProtocolCapability, Version, VersionServer, version_number
from gloc3.messages.vehicle import Style, VehicleClass
from gloc3_onboard.autopilot.inspection import RALLY_S, REMOTE_ID_SILENT_S, Inspection

OWN, VEHICLE = Address(1, 191), Address(1, 1)
NAMES = ("NAV_DLL_ACT", "COM_DL_LOSS_T", "NEVER_HEARD_OF")
STEP_S = 0.05
NOTHING, RALLY = ProtocolCapability(0), ProtocolCapability.MISSION_RALLY


class Rig:
    """An inspection and the autopilot that it looks at, message by message."""

    def __init__(self, style: Style = Style.PX4, capabilities: ProtocolCapability = NOTHING) -> None:
        encoding = ParameterEncoding.BYTEWISE if style is Style.PX4 else ParameterEncoding.CAST
        self.commands = MavCommandClient(OWN)
        self.plans = MissionClient(OWN)
        self.inspection = Inspection(OWN, self.commands, self.plans)
        self.server = MavCommandServer(VEHICLE, is_autopilot=True)
        self.version = VersionServer(
            VEHICLE, Version(capabilities=capabilities, flight_software=version_number(1, 15, 2))
        )
        self.parameters = ParameterServer(
            VEHICLE,
            [parameter("NAV_DLL_ACT", 2, ParameterType.INT32), parameter("COM_DL_LOSS_T", 7.5)],
            encoding=encoding,
        )
        self.held = MissionServer(VEHICLE)
        self.here = MavlinkComponent(OWN, [self.commands, self.plans, self.inspection])
        self.there = MavlinkComponent(VEHICLE, [self.server, self.version, self.parameters, self.held])
        self.own_encoder, self.own_parser = Encoder(*OWN), Parser()
        self.encoder, self.parser = Encoder(*VEHICLE), Parser()
        self.deaf_to: set[str] = set()
        self.requested: list[str] = []
        self.now_s = 0.0
        self.style = style

    def adopt(self) -> None:
        self.inspection.adopt(VEHICLE, self.style, VehicleClass.COPTER, NAMES, self.now_s)

    def run(self, seconds: float) -> None:
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.now_s += STEP_S
            self.here.tick(self.now_s)
            for sent in self.here.outgoing():
                self.requested.append(sent.param_id if sent.name == "PARAM_REQUEST_READ" else sent.name)
                if self.requested[-1] not in self.deaf_to:
                    for frame in self.own_parser.receive(self.own_encoder.encode(sent)):
                        self.there.receive(frame, self.now_s)
            for request in self.server.events():
                result = self.version.command(request)
                self.server.answer(request, result or CommandResult.UNSUPPORTED, now_s=self.now_s)
            for answer in self.there.outgoing():
                for frame in self.parser.receive(self.encoder.encode(answer)):
                    self.here.receive(frame, self.now_s)
            for call in self.commands.events():
                self.inspection.ended(call, self.now_s)
            for event in self.plans.events():
                if isinstance(event, Transfer):
                    self.inspection.transferred(event, self.now_s)

    def hears(self, name: str, **fields: Any) -> None:
        self.inspection.receive(message(name, **fields), VEHICLE, self.now_s)


@pytest.mark.parametrize("style", Style)
def test_everything_is_read_when_an_autopilot_comes(style: Style) -> None:
    rig = Rig(style)
    rig.adopt()
    rig.run(1.0)
    setup = rig.inspection.setup
    assert setup.is_complete
    assert setup.parameters == {"NAV_DLL_ACT": 2.0, "COM_DL_LOSS_T": 7.5}
    assert setup.unread == ["NEVER_HEARD_OF"]
    assert (setup.firmware, setup.is_official) == ((1, 15, 2), True)


def test_a_further_reading_ends_with_its_number_and_leaves_out_what_is_not_there() -> None:
    rig = Rig()
    rig.adopt()
    rig.run(1.0)
    rig.parameters.set("NAV_DLL_ACT", 0)
    rig.parameters.outgoing()  # that it was changed is lost in transit
    rig.requested.clear()
    rig.inspection.read(1, rig.now_s)
    rig.inspection.read(2, rig.now_s)
    rig.run(1.0)
    assert rig.inspection.setup.number == 2
    assert rig.inspection.setup.parameters["NAV_DLL_ACT"] == 0.0
    assert "NEVER_HEARD_OF" not in rig.requested


def test_what_somebody_sets_is_taken_in_at_once() -> None:
    rig = Rig()
    rig.adopt()
    rig.run(1.0)
    rig.parameters.set("NAV_DLL_ACT", 3)
    rig.run(0.2)
    assert rig.inspection.setup.parameters["NAV_DLL_ACT"] == 3.0


def test_an_old_autopilot_that_does_not_answer_for_what_it_does_not_know_is_read_all_the_same() -> None:
    rig = Rig()
    rig.deaf_to = {"NEVER_HEARD_OF"}
    rig.adopt()
    rig.run(8.0)
    assert rig.inspection.setup.is_complete
    rig.inspection.read(1, rig.now_s)
    rig.run(1.0)
    assert rig.inspection.setup.number == 1


def test_a_reading_of_which_something_known_stays_away_does_not_count() -> None:
    rig = Rig()
    rig.adopt()
    rig.run(1.0)
    rig.deaf_to = {"NAV_DLL_ACT"}
    rig.inspection.read(1, rig.now_s)
    rig.run(8.0)
    setup = rig.inspection.setup
    assert (setup.number, setup.is_complete) == (0, False)
    assert "NAV_DLL_ACT" in setup.unread
    assert setup.parameters["NAV_DLL_ACT"] == 2.0


def test_a_restarted_autopilot_is_read_from_the_begin() -> None:
    rig = Rig()
    rig.adopt()
    rig.run(0.1)
    rig.adopt()
    assert not rig.inspection.setup.parameters
    rig.run(1.0)
    assert rig.inspection.setup.is_complete


def test_sensors_and_time_of_day_are_told() -> None:
    rig = Rig()
    rig.adopt()
    rig.run(1.0)
    bits = {"present": 63, "enabled": 47, "health": 15}
    rig.hears("SYS_STATUS", **{f"onboard_control_sensors_{name}": value for name, value in bits.items()})
    rig.hears("SYSTEM_TIME", time_unix_usec=1_700_000_000_000_000)
    setup = rig.inspection.setup
    assert (setup.sensors_present, setup.sensors_enabled, setup.sensors_health) == (63, 47, 15)
    assert setup.utc_minus_t_s == pytest.approx(1_700_000_000 - rig.now_s, abs=0.06)
    rig.hears("SYSTEM_TIME", time_unix_usec=0)
    assert rig.inspection.setup.utc_minus_t_s is None


def test_the_rally_points_are_counted_and_again_with_each_reading() -> None:
    rig = Rig(capabilities=RALLY)
    rig.held.set_plan(PlanType.RALLY, (PlanItem(command=5100, frame=3), PlanItem(command=5100, frame=3)))
    rig.adopt()
    rig.run(1.0)
    assert (rig.inspection.setup.is_complete, rig.inspection.setup.rally_points) == (True, 2)
    rig.held.set_plan(PlanType.RALLY, ())
    rig.inspection.read(1, rig.now_s)
    rig.run(1.0)
    assert (rig.inspection.setup.number, rig.inspection.setup.rally_points) == (1, 0)


@pytest.mark.parametrize(
    ("style", "capabilities"),
    [(Style.PX4, NOTHING), (Style.ARDUPILOT, RALLY)],
    ids=["has none", "by parameter"],
)
def test_rally_points_are_requested_only_where_that_is_the_way(style: Style, capabilities: ProtocolCapability) -> None:
    rig = Rig(style, capabilities)
    rig.adopt()
    rig.run(1.0)
    assert rig.inspection.setup.rally_points is None
    assert "MISSION_REQUEST_LIST" not in rig.requested


def test_rally_points_that_do_not_come_hold_nothing_up() -> None:
    rig = Rig(capabilities=RALLY)
    rig.deaf_to = {"MISSION_REQUEST_LIST"}
    rig.adopt()
    rig.run(RALLY_S + 1.0)
    assert (rig.inspection.setup.is_complete, rig.inspection.setup.rally_points) == (True, None)


def test_a_remote_id_tells_whether_it_is_good_to_arm_and_counts_as_failed_when_it_falls_silent() -> None:
    rig = Rig()
    transmitter = Address(VEHICLE.system, 236)
    rig.adopt()
    rig.run(1.0)
    assert rig.inspection.setup.remote_id is None, "there is none"
    bad = message("OPEN_DRONE_ID_ARM_STATUS", status=1, error="no \x1b[31moperator location")
    rig.inspection.receive(bad, Address(VEHICLE.system + 1, 236), rig.now_s)
    assert rig.inspection.setup.remote_id is None, "it is another vehicle's"
    rig.inspection.receive(bad, transmitter, rig.now_s)
    assert rig.inspection.setup.remote_id == "no [31moperator location"
    rig.inspection.receive(message("OPEN_DRONE_ID_ARM_STATUS", status=1), transmitter, rig.now_s)
    assert rig.inspection.setup.remote_id == "it gives no reason (status 1)"
    rig.inspection.receive(message("OPEN_DRONE_ID_ARM_STATUS", status=0, error="x"), VEHICLE, rig.now_s)
    assert rig.inspection.setup.remote_id == ""
    rig.run(REMOTE_ID_SILENT_S - 0.5)
    assert rig.inspection.setup.remote_id == ""
    rig.run(1.0)
    assert rig.inspection.setup.remote_id == "it has not reported for 10 s"
    assert rig.inspection.next_tick_s() is None
