"""Presets of parameters: the files, what they would change, and that nothing is set that was not shown and asked for."""

from collections.abc import Callable
from pathlib import Path

import pytest

from gloc3.errors import InputError, Refused
from gloc3.mavlink.codec import Encoder, MavlinkMessage, Parser
from gloc3.mavlink.message import Address
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.services.heartbeat import Heartbeat
from gloc3.mavlink.services.parameter import Parameter, ParameterEncoding, ParameterType
from gloc3.mavlink.services.parameter_server import ParameterServer
from gloc3.messages.preflight import Verdict
from gloc3.messages.readiness import AutopilotSetup
from gloc3.messages.vehicle import Style, VehicleClass
from gloc3.platform.reader import load_platform
from gloc3_onboard.autopilot import ardupilot, px4
from gloc3_onboard.autopilot.presets.files import Preset, PresetValue, load_preset, preset_files
from gloc3_onboard.autopilot.presets.session import PresetSession, PresetStage
from gloc3_onboard.checks.failsafes import failsafe_checks
from gloc3_onboard.checks.readings import Readings
from gloc3_onboard.checks.tables import table_of

VEHICLE, COMPANION = Address(1, 1), Address(1, 191)
SUB = load_preset("ardusub_companion")
FACTORY = {"FS_GCS_ENABLE": 2, "FS_PILOT_INPUT": 2, "BATT_FS_LOW_ACT": 3}


def keep_all(_wanted: Parameter) -> None:
    """Allows everything."""


class Rig:
    """A session and an autopilot, whose bytes lose every `lose`-th frame."""

    def __init__(
        self,
        preset: Preset = SUB,
        *,
        vehicle_type: int = 12,
        values: dict[str, int] | None = None,
        check: Callable[[Parameter], None] = keep_all,
        lose: int = 0,
    ) -> None:
        self.session = PresetSession(COMPANION, preset)
        parameters = [Parameter(name, float(value), ParameterType.INT8) for name, value in (values or FACTORY).items()]
        self.server = ParameterServer(VEHICLE, parameters, encoding=ParameterEncoding.CAST, check=check)
        self.heartbeat = Heartbeat(VEHICLE, vehicle_type=vehicle_type, autopilot=3)
        self.set: list[str] = []
        self.now_s = 0.0
        self._lose, self._count = lose, 0
        self._vehicle = MavlinkComponent(VEHICLE, [self.server, self.heartbeat])
        self._companion = MavlinkComponent(COMPANION, [self.session])

    def run(self, seconds: float) -> "Rig":
        for _ in range(round(seconds / 0.02)):
            self.now_s += 0.02
            self._pass(self._companion, self._vehicle)
            self._pass(self._vehicle, self._companion)
        return self

    def _pass(self, sender: MavlinkComponent, receiver: MavlinkComponent) -> None:
        sender.tick(self.now_s)
        for message in sender.outgoing():
            self._note(message)
            self._count += 1
            if not self._lose or self._count % self._lose:
                for frame in Parser(is_datagram=True).receive(Encoder(*sender.own).encode(message)):
                    receiver.receive(frame, self.now_s)

    def _note(self, message: MavlinkMessage) -> None:
        if message.name == "PARAM_SET":
            self.set.append(message.param_id)

    def value(self, name: str) -> float:
        return self.server[name]


@pytest.mark.parametrize("name", sorted(preset_files()))
def test_every_preset_that_ships_can_be_read_and_is_for_a_class_that_is_known(name: str) -> None:
    preset = load_preset(name)
    assert preset.preset == name
    classes = px4.CLASSES if preset.style is Style.PX4 else ardupilot.CLASSES
    assert preset.vehicle in classes
    assert all(row.why for row in preset.parameters.values()), "each says why"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("preset: x\nstyle: ardupilot\nvehicle: sub\nparameters: {fs: {value: 1}}\n", "x.yaml:4"),
        ("preset: x\nstyle: arducopter\nvehicle: sub\nparameters: {}\n", "x.yaml:2"),
        ("preset: x\nstyle: px4\nvehicle: sub\nparameters: {A: {value: 1}}\nrestart: [B]\n", "B is not among"),
    ],
)
def test_a_wrong_file_is_refused_with_its_line(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "x.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        load_preset(str(file))


def test_a_name_that_is_not_known_gets_the_nearest_one() -> None:
    with pytest.raises(InputError, match="ardusub_companion"):
        load_preset("ardusub_compannion")


def test_the_difference_is_shown_and_nothing_is_set_unless_asked() -> None:
    rig = Rig().run(10.0)
    assert rig.session.stage is PresetStage.READ
    assert [str(change).splitlines()[:2] for change in rig.session.changes if change.is_needed] == [
        ["- FS_GCS_ENABLE 2", "+ FS_GCS_ENABLE 0   # the mission's on_link_loss decides what a lost station means"],
        ["- FS_PILOT_INPUT 2", "+ FS_PILOT_INPUT 0   # nobody need hold a joystick"],
    ]
    assert rig.set == []


@pytest.mark.parametrize("lose", [0, 3])
def test_what_differs_is_set_and_read_again(lose: int) -> None:
    rig = Rig(values={"FS_GCS_ENABLE": 2, "FS_PILOT_INPUT": 0}, lose=lose).run(10.0)
    rig.session.apply(rig.now_s)
    rig.run(15.0)
    assert rig.session.stage is PresetStage.DONE, rig.session.problem
    assert (rig.value("FS_GCS_ENABLE"), rig.value("FS_PILOT_INPUT")) == (0.0, 0.0)
    assert set(rig.set) == {"FS_GCS_ENABLE"}, "what is right already is left alone"
    assert not any(change.is_needed for change in rig.session.changes)


def test_a_value_that_the_vehicle_keeps_is_a_failure() -> None:
    def refuse(wanted: Parameter) -> None:
        if wanted.name == "FS_GCS_ENABLE":
            raise Refused("read only")

    rig = Rig(check=refuse).run(5.0)
    rig.session.apply(rig.now_s)
    rig.run(20.0)
    assert rig.session.stage is PresetStage.FAILED
    assert "FS_GCS_ENABLE" in rig.session.problem
    assert rig.value("FS_PILOT_INPUT") == 0.0


def test_a_parameter_that_is_not_there_is_told_and_the_others_are_set() -> None:
    rig = Rig(values={"FS_GCS_ENABLE": 2}).run(12.0)
    assert str(rig.session.changes[1]).startswith("! FS_PILOT_INPUT: ")
    rig.session.apply(rig.now_s)
    rig.run(10.0)
    assert rig.session.stage is PresetStage.DONE
    assert rig.value("FS_GCS_ENABLE") == 0.0


@pytest.mark.parametrize(("name", "value"), [("RTL_ALTITUDE", 60), ("ALT_HOLD_RTL", 6000)])
def test_a_parameter_is_set_by_the_name_that_the_vehicle_has_for_it(name: str, value: float) -> None:
    row = PresetValue(60, "below the ceiling", {"ALT_HOLD_RTL": 6000})
    preset = Preset("x", Style.ARDUPILOT, VehicleClass.SUB, {"RTL_ALTITUDE": row})
    rig = Rig(preset)
    rig.server = ParameterServer(VEHICLE, [Parameter(name, 1.0)], encoding=ParameterEncoding.CAST)
    rig._vehicle = MavlinkComponent(VEHICLE, [rig.server, rig.heartbeat])
    rig.run(12.0)
    assert [(change.name, change.now, change.wanted) for change in rig.session.changes] == [(name, 1.0, value)]
    rig.session.apply(rig.now_s)
    rig.run(10.0)
    assert rig.session.stage is PresetStage.DONE, rig.session.problem
    assert rig.value(name) == value


@pytest.mark.parametrize("name", ["arduplane_companion", "px4_plane_companion"])
def test_a_plane_with_its_preset_has_no_red_failsafe(name: str) -> None:
    preset = load_preset(name)
    table = table_of(preset.style, preset.vehicle)
    assert preset.vehicle is VehicleClass.PLANE

    def reds(values: dict[str, float]) -> list[str]:
        known = {one: values[one] for one in table.names() if one in values}
        setup = AutopilotSetup(style=preset.style, vehicle=preset.vehicle, parameters=known, is_complete=True)
        readings = Readings(platform=load_platform("plane"), now_s=1.0, setup=setup)
        return [line.title for line in failsafe_checks(readings) if line.verdict is Verdict.RED]

    stock: dict[str, float] = {
        "NAV_DLL_ACT": 0,
        "COM_OBL_RC_ACT": 0,
        "MIS_TKO_LAND_REQ": 2,
        "FS_GCS_ENABL": 1,
        "FS_LONG_ACTN": 1,
    }
    stock |= {"COM_LOW_BAT_ACT": 0, "BATT_FS_LOW_ACT": 0}
    assert reds(stock)
    assert reds(stock | preset.values()) == []


def test_another_kind_of_vehicle_is_left_alone() -> None:
    rig = Rig(vehicle_type=2).run(3.0)
    assert rig.session.stage is PresetStage.FAILED
    assert rig.session.problem == "the autopilot is ardupilot on a copter; the preset is for ardupilot on a sub"
    rig.session.apply(rig.now_s)
    rig.run(3.0)
    assert rig.set == []


def test_an_armed_vehicle_is_left_alone() -> None:
    rig = Rig()
    rig.heartbeat.base_mode = 128
    rig.run(5.0)
    rig.session.apply(rig.now_s)
    rig.run(3.0)
    assert rig.set == []
    assert "armed" in rig.session.problem


def test_a_fraction_is_the_same_when_it_comes_back_as_a_32_bit_float() -> None:
    preset = Preset("x", Style.ARDUPILOT, VehicleClass.SUB, {"RATE": PresetValue(0.1)})
    rig = Rig(preset)
    rig.server = ParameterServer(VEHICLE, [Parameter("RATE", 0.25)], encoding=ParameterEncoding.CAST)
    rig._vehicle = MavlinkComponent(VEHICLE, [rig.server, rig.heartbeat])
    rig.run(3.0)
    rig.session.apply(rig.now_s)
    rig.run(5.0)
    assert rig.session.stage is PresetStage.DONE, rig.session.problem
