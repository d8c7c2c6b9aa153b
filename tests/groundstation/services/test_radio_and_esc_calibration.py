"""The transmitter and the ESCs: measured, found, written as each firmware's parameters, or refused in words."""

import asyncio

import pytest

from gloc3.errors import Refused
from gloc3.mavlink.services.calibration import CalibrationKind, CalibrationPhase, CalibrationState
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandRequest
from gloc3.mavlink.services.heartbeat import ARMED
from gloc3.mavlink.services.parameter import Parameter, ParameterType, parameter

from .scripted_vehicle import ARDUPILOT, PX4, VEHICLE, Scene, over

REST = {1: 1510, 2: 1490, 3: 1010, 4: 1500, 5: 1005, 6: 1500}
"""Roll, pitch, throttle and yaw; a switch; a channel that nothing moves."""


def px4_parameters() -> list[Parameter]:
    names = [f"RC{n}_{what}" for n in range(1, 7) for what in ("MIN", "TRIM", "MAX", "REV")]
    maps = ["RC_CHAN_CNT", *(f"RC_MAP_{stick}" for stick in ("ROLL", "PITCH", "THROTTLE", "YAW"))]
    return [
        *(parameter(name, 1500.0, ParameterType.REAL32) for name in names),
        *(parameter(name, 0, ParameterType.INT32) for name in maps),
    ]


def ardupilot_parameters(escs: int | None = 0) -> list[Parameter]:
    names = {f"RC{n}_{what}": 1500 for n in range(1, 7) for what in ("MIN", "TRIM", "MAX")}
    names |= {"RCMAP_ROLL": 1, "RCMAP_PITCH": 2, "RCMAP_THROTTLE": 3, "RCMAP_YAW": 4}
    if escs is not None:
        names["ESC_CALIBRATION"] = escs
    return [parameter(name, value, ParameterType.INT16) for name, value in names.items()]


def accept(request: MavCommandRequest) -> CommandResult | None:
    return CommandResult.ACCEPTED if request.command in (241, 511) else None


class Pilot:
    """Moves the sticks, and follows the calibration."""

    def __init__(self, scene: Scene, kind: CalibrationKind = CalibrationKind.RADIO) -> None:
        scene.vehicle.answer = accept
        self.scene, self.seen = scene, list[CalibrationState]()
        self.task = asyncio.ensure_future(scene.services.calibration.run(kind, self.seen.append))

    @property
    def said(self) -> str:
        return self.seen[-1].instruction

    async def hold(self, seconds: float = 1.0, **moved: int) -> None:
        """Holds sticks at pulses, as `ch3=1990`; the others rest."""
        pulses = REST | {int(name[2:]): pulse for name, pulse in moved.items()}
        for _ in range(round(seconds * 10)):
            fields = {f"chan{number}_raw": pulses.get(number, 65535) for number in range(1, 19)}
            self.scene.vehicle.send("RC_CHANNELS", time_boot_ms=1, chancount=6, rssi=255, **fields)
            await self.scene.pass_s(0.1)

    async def confirm(self) -> None:
        self.scene.services.calibration.confirm()
        await self.scene.pass_s(0.1)

    async def to_their_ends(self) -> None:
        await self.hold(ch1=1020, ch2=1030, ch4=1040, ch5=2010)
        await self.hold(ch1=1980, ch2=1970, ch3=1990, ch4=1960)


def stored(scene: Scene, *names: str) -> dict[str, float]:
    return {name: scene.vehicle.parameters[name] for name in names}


def preflight(scene: Scene) -> list[tuple[float, ...]]:
    return [request.params for request in scene.vehicle.requested if request.command == 241]


def test_px4_is_shown_each_stick_and_gets_its_parameters() -> None:
    async def play(scene: Scene) -> None:
        pilot = Pilot(scene)
        await pilot.hold(5.5)
        assert pilot.said == "centre the sticks, the throttle down; then confirm"
        await pilot.confirm()
        for said, moved in (
            ("throttle stick fully up", {"ch3": 1990}),
            ("yaw stick fully to the right", {"ch4": 1960}),
            ("roll stick fully to the right", {"ch1": 1980}),
            ("pitch stick fully forward", {"ch2": 1030}),
        ):
            assert said in pilot.said
            await pilot.hold(**moved)
        await pilot.to_their_ends()
        await pilot.confirm()
        await pilot.hold(ch3=1990)
        await pilot.confirm()
        assert "the throttle is not down (1990 µs)" in pilot.said
        await pilot.hold()
        await pilot.confirm()
        assert "confirm to write 24 parameters" in pilot.said
        channel = pilot.seen[-1].channels[1]
        assert (channel.minimum_us, channel.centre_us, channel.maximum_us) == (1030, 1490, 1970)
        assert (channel.role, channel.is_reversed) == ("pitch", True)
        assert stored(scene, "RC1_MIN") == {"RC1_MIN": 1500}, "nothing is written before the last confirmation"
        await pilot.confirm()
        for _ in range(100):
            await pilot.hold(0.1)
        state = await pilot.task
        assert (state.phase, state.reason) == (CalibrationPhase.DONE, "24 parameters written and read back")
        assert stored(scene, "RC1_MIN", "RC1_TRIM", "RC1_MAX", "RC1_REV") == {
            "RC1_MIN": 1020, "RC1_TRIM": 1510, "RC1_MAX": 1980, "RC1_REV": 1
        }  # fmt: skip
        assert stored(scene, "RC2_REV", "RC3_TRIM", "RC5_MIN", "RC5_TRIM", "RC6_MIN", "RC_CHAN_CNT") == {
            "RC2_REV": -1, "RC3_TRIM": 1010, "RC5_MIN": 1005, "RC5_TRIM": 1507, "RC6_MIN": 1500, "RC_CHAN_CNT": 6
        }  # fmt: skip
        maps = stored(scene, "RC_MAP_ROLL", "RC_MAP_PITCH", "RC_MAP_THROTTLE", "RC_MAP_YAW")
        assert list(maps.values()) == [1, 2, 3, 4]
        assert preflight(scene) == [(0, 0, 0, 1, 0, 0, 0), (0,) * 7], "PX4 ignores the sticks, and takes them again"

    over(play, autopilot=PX4, parameters=px4_parameters())


def test_ardupilot_knows_its_sticks_and_gets_ends_and_centres_alone() -> None:
    async def play(scene: Scene) -> None:
        pilot = Pilot(scene)
        await pilot.hold(3.0)
        await pilot.confirm()
        assert pilot.said.startswith("roll (channel 1) has moved by 0 µs only, of 600 µs at least: move all sticks")
        await pilot.to_their_ends()
        await pilot.confirm()
        await pilot.hold(ch4=1900)
        await pilot.confirm()
        assert "yaw is not centred (1900 µs, from 1040 to 1960 µs)" in pilot.said
        await pilot.hold()
        await pilot.confirm()
        await pilot.confirm()
        await pilot.hold(6.0)
        assert (await pilot.task).reason == "15 parameters written and read back"
        assert stored(scene, "RC3_MIN", "RC3_TRIM", "RC3_MAX", "RC6_MAX") == {
            "RC3_MIN": 1010, "RC3_TRIM": 1010, "RC3_MAX": 1990, "RC6_MAX": 1500
        }  # fmt: skip
        assert preflight(scene) == []

    over(play, autopilot=ARDUPILOT, parameters=ardupilot_parameters())


def test_without_a_receiver_or_armed_nothing_is_written() -> None:
    async def play(scene: Scene) -> None:
        pilot = Pilot(scene)
        await scene.pass_s(15.0)
        state = await pilot.task
        assert state.phase is CalibrationPhase.FAILED
        assert "no receiver is heard" in state.reason
        pilot = Pilot(scene)
        await pilot.hold(2.0)
        scene.vehicle.heartbeat.base_mode |= ARMED
        await pilot.hold(2.0)
        assert (await pilot.task).reason == "the vehicle was armed meanwhile; nothing was written"
        with pytest.raises(Refused, match="the vehicle is armed"):
            await scene.services.calibration.run(CalibrationKind.RADIO)
        assert preflight(scene)[-1] == (0,) * 7

    over(play, autopilot=PX4, parameters=px4_parameters())


def test_a_vehicle_that_lacks_a_parameter_keeps_all_of_them() -> None:
    async def play(scene: Scene) -> None:
        pilot = Pilot(scene)
        await pilot.hold(3.0)
        await pilot.to_their_ends()
        await pilot.confirm()
        await pilot.hold()
        await pilot.confirm()
        await pilot.confirm()
        for _ in range(600):
            await pilot.hold(0.1)
            if pilot.task.done():
                break
        state = await pilot.task
        assert state.phase is CalibrationPhase.FAILED
        assert "0 parameters written; not all of them: RC5_" in state.reason
        assert stored(scene, "RC1_MIN") == {"RC1_MIN": 1500}

    over(
        play,
        autopilot=ARDUPILOT,
        parameters=[one for one in ardupilot_parameters() if not one.name.startswith("RC5")],
    )


def test_the_escs_of_px4_follow_its_texts() -> None:
    async def play(scene: Scene) -> None:
        pilot = Pilot(scene, CalibrationKind.ESC)
        await scene.pass_s(6.0)
        scene.vehicle.report("[cal] calibration started: 2 esc", "[cal] Connect battery now")
        await scene.pass_s(1.0)
        assert pilot.said == "Connect battery now"
        scene.vehicle.report("[cal] Battery connected")
        await scene.pass_s(8.0)
        scene.vehicle.report("[cal] calibration done: esc")
        assert (await pilot.task).phase is CalibrationPhase.DONE
        assert preflight(scene) == [(0, 0, 0, 0, 0, 0, 1)]
        scene.vehicle.answer = lambda request: CommandResult.DENIED if request.command == 241 else None
        state = await scene.services.calibration.run(CalibrationKind.ESC)
        assert state.reason.endswith("the battery must be disconnected, and USB power the autopilot")

    over(play, autopilot=PX4)


def test_the_escs_of_ardupilot_are_calibrated_at_the_next_start() -> None:
    async def play(scene: Scene) -> None:
        pilot = Pilot(scene, CalibrationKind.ESC)
        await scene.pass_s(10.0)
        assert stored(scene, "ESC_CALIBRATION") == {"ESC_CALIBRATION": 3}
        assert "Connect the battery" in pilot.said
        await pilot.confirm()
        await scene.pass_s(2.0)
        assert pilot.said.startswith(
            "ESC_CALIBRATION is still 3, so the vehicle has not been started again: disconnect"
        )
        scene.vehicle.parameters.set("ESC_CALIBRATION", 0)
        await pilot.confirm()
        assert (await pilot.task).phase is CalibrationPhase.DONE
        pilot = Pilot(scene, CalibrationKind.ESC)
        await scene.pass_s(3.0)
        pilot.task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await pilot.task
        await scene.pass_s(3.0)
        assert stored(scene, "ESC_CALIBRATION") == {"ESC_CALIBRATION": 0}, "else the motors turn at the next start"
        assert pilot.seen[-1].reason == "ESC_CALIBRATION is 0 again"

    over(play, autopilot=ARDUPILOT, parameters=ardupilot_parameters())


@pytest.mark.parametrize(
    ("escs", "reason"), [(None, "ArduCopter alone has ESC_CALIBRATION"), (9, "is 9, which disables")]
)
def test_an_ardupilot_that_cannot_calibrate_its_escs_says_why(escs: int | None, reason: str) -> None:
    async def play(scene: Scene) -> None:
        with pytest.raises(Refused, match=reason):
            await scene.services.calibration.run(CalibrationKind.ESC)
        assert scene.services.target == VEHICLE

    over(play, autopilot=ARDUPILOT, parameters=ardupilot_parameters(escs))
