"""Refusals of a bare vehicle: with the autopilot's own reason, which it sends as a status text."""

import pytest
from tests.groundstation.services.scripted_vehicle import ARDUPILOT, PX4, Scene, over

from gloc3.errors import Refused
from gloc3.mavlink.services.calibration import CalibrationKind
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandRequest
from gloc3_groundstation.services.actions import DO_SET_MODE, Action


@pytest.mark.parametrize("is_early", [True, False])
def test_a_refusal_has_the_autopilots_own_reason_and_none_of_another_moment(is_early: bool) -> None:
    async def play(scene: Scene) -> None:
        vehicle, loop = scene.vehicle, scene.services.machines.loop

        def say(text: str, severity: int) -> None:
            vehicle.texts.send(severity, text)
            vehicle.runner.settle()

        def refuse(request: MavCommandRequest) -> CommandResult | None:
            if request.command != DO_SET_MODE:
                return None
            for text, severity in (("PreArm: Compass not calibrated\t", 4), ("by the way", 6)):
                if is_early:
                    say(text, severity)
                else:
                    loop.call_later(0.1, say, text, severity)
            return CommandResult.DENIED

        vehicle.answer = refuse
        await scene.pass_s(2.0)
        say("low battery", 2)
        await scene.pass_s(2.0)
        with pytest.raises(Refused) as refusal:
            await scene.services.actions.act(Action.HOLD)
        assert str(refusal.value) == f"mode Hold: {CommandResult.DENIED.words}: PreArm: Compass not calibrated"
        vehicle.answer = lambda request: CommandResult.DENIED if request.command == DO_SET_MODE else None
        await scene.pass_s(2.0)
        with pytest.raises(Refused) as refusal:
            await scene.services.actions.set_mode("mission")
        assert str(refusal.value) == f"mode Mission: {CommandResult.DENIED.words}"

    over(play, autopilot=PX4)


@pytest.mark.parametrize("altitude_m", [1e9, -1e9, float("inf"), float("nan")])
def test_a_place_at_no_altitude_of_a_vehicle_is_refused_before_anything_is_sent(altitude_m: float) -> None:
    async def play(scene: Scene) -> None:
        with pytest.raises(Refused, match="altitude"):
            await scene.services.actions.act(Action.GO_TO, 47.1, 8.5, altitude_m, float("nan"))
        assert not scene.vehicle.requested

    over(play, autopilot=PX4)


def test_a_motor_test_and_a_calibration_have_it_too() -> None:
    async def play(scene: Scene) -> None:
        def refuse(request: MavCommandRequest) -> CommandResult | None:
            if request.command not in (209, 241):
                return None
            scene.vehicle.texts.send(4, "PreArm: Safety switch")
            return CommandResult.FAILED

        scene.vehicle.answer = refuse
        await scene.services.learn()
        with pytest.raises(Refused, match=r"motor 1: .*: PreArm: Safety switch$"):
            await scene.services.motors.run(1)
        await scene.pass_s(2.0)
        state = await scene.services.calibration.run(CalibrationKind.GYRO)
        assert state.reason == f"the vehicle's answer: {CommandResult.FAILED.words}: PreArm: Safety switch"

    over(play, autopilot=ARDUPILOT)
