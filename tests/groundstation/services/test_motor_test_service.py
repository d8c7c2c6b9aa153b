"""The motor test: weak, short, disarmed, on the ground; stopped when it is left, refused in words."""

import asyncio
import math

import pytest

from gloc3.errors import Refused
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandRequest
from gloc3.mavlink.services.heartbeat import ARMED
from gloc3_groundstation.services.motor_test import MotorTestSettings
from gloc3_groundstation.services.progress import JobProgress

from .scripted_vehicle import ARDUPILOT, PX4, Scene, over

COMMANDS = {PX4: 310, ARDUPILOT: 209}


def commanded(scene: Scene) -> list[tuple[float, ...]]:
    return [one.params for one in scene.vehicle.requested if one.command in COMMANDS.values()]


def accepted(request: MavCommandRequest) -> CommandResult | None:
    return CommandResult.ACCEPTED if request.command in COMMANDS.values() else None


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_a_motor_turns_weakly_and_shortly_with_progress(autopilot: int) -> None:
    async def play(scene: Scene) -> None:
        scene.vehicle.answer = accepted
        begin_s, seen = scene.services.machines.now_s, list[JobProgress]()
        await scene.services.motors.run(3, on_progress=seen.append)
        assert scene.services.machines.now_s - begin_s == pytest.approx(2.0, abs=1.5)
        (params,) = commanded(scene)
        expected = (0.1, 2.0, 0.0, 0.0, 3.0) if autopilot == PX4 else (3.0, 0.0, 10.0, 2.0, 1.0)
        assert params[:5] == pytest.approx(expected)
        assert seen[0].what == "motor 3 turns with 10 %"
        assert [one.fraction for one in seen] == sorted(one.fraction or 0.0 for one in seen)

    over(play, autopilot=autopilot)


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_a_test_that_is_left_is_stopped_on_the_vehicle(autopilot: int) -> None:
    async def play(scene: Scene) -> None:
        scene.vehicle.answer = accepted
        task = asyncio.ensure_future(scene.services.motors.run(1))
        await scene.pass_s(1.5)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        await scene.pass_s(1.0)
        begun, stopped = commanded(scene)
        if autopilot == PX4:
            assert math.isnan(stopped[0])
            assert (begun[4], stopped[1], stopped[4]) == (1.0, 0.0, 1.0)
        else:
            assert stopped[:4] == (1.0, 0.0, 0.0, 0.0)

    over(play, autopilot=autopilot)


def test_an_armed_or_flying_vehicle_is_refused_before_anything_is_sent() -> None:
    async def play(scene: Scene) -> None:
        scene.vehicle.answer = accepted
        await scene.services.learn()
        scene.vehicle.send("EXTENDED_SYS_STATE", vtol_state=0, landed_state=2)
        await scene.pass_s(0.5)
        with pytest.raises(Refused, match="in the air"):
            await scene.services.motors.run(1)
        scene.vehicle.send("EXTENDED_SYS_STATE", vtol_state=0, landed_state=1)
        scene.vehicle.heartbeat.base_mode |= ARMED
        await scene.pass_s(2.0)
        with pytest.raises(Refused, match="the vehicle is armed"):
            await scene.services.motors.run(1)
        for motor, settings, reason in (
            (0, MotorTestSettings(), "from 1 to 12"),
            (1, MotorTestSettings(percent=90.0), "at most 50 %"),
            (1, MotorTestSettings(seconds=30.0), "at most 3 s"),
            (1, MotorTestSettings(percent=math.nan), "at most 50 %"),
        ):
            with pytest.raises(Refused, match=reason):
                await scene.services.motors.run(motor, settings)
        assert commanded(scene) == []

    over(play)


def test_a_vehicle_says_no_or_nothing() -> None:
    async def play(scene: Scene) -> None:
        scene.vehicle.answer = lambda request: CommandResult.DENIED if request.command == 310 else None
        with pytest.raises(Refused, match=r"motor 2: .*denied.*COM_MOT_TEST_EN must be 1"):
            await scene.services.motors.run(2)
        scene.cut()
        with pytest.raises(Refused, match=r"motor 2: .*answer"):
            await scene.services.motors.run(2)

    over(play)
