"""Calibration: what PX4 and ArduPilot say of it becomes states with instructions; it is confirmed and cancelled."""

import asyncio

import pytest

from gloc3.errors import Refused
from gloc3.mavlink.services.calibration import CalibrationKind, CalibrationPhase, CalibrationState, Side, SideState
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandRequest
from gloc3.mavlink.transport.memory import Conditions

from .scripted_vehicle import ARDUPILOT, Scene, over


def accept(request: MavCommandRequest) -> CommandResult | None:
    return CommandResult.ACCEPTED if request.command in (241, 42424, 42426, 42429) else None


def begin(scene: Scene, kind: CalibrationKind) -> tuple["asyncio.Task[CalibrationState]", list[CalibrationState]]:
    scene.vehicle.answer = accept
    seen: list[CalibrationState] = []
    return asyncio.ensure_future(scene.services.calibration.run(kind, seen.append)), seen


def test_a_gyro_of_px4() -> None:
    async def play(scene: Scene) -> None:
        task, seen = begin(scene, CalibrationKind.GYRO)
        await scene.pass_s(2.0)
        scene.vehicle.report(
            "[cal] calibration started: 2 gyro", "[cal] progress <5>", "GPS lost", "[cal] progress <95>"
        )
        scene.vehicle.report("[cal] calibration done: gyro")
        state = await task
        assert (state.phase, state.progress) == (CalibrationPhase.DONE, 1.0)
        assert [one.progress for one in seen if one.progress is not None][:3] == [0.0, 0.0, 0.05]
        assert any(one.instruction == "keep the vehicle still" for one in seen)
        assert "GPS lost" not in state.texts
        assert [request.params[:6] for request in scene.vehicle.requested if request.command == 241] == [
            (1, 0, 0, 0, 0, 0)
        ]

    over(play, Conditions(latency_s=0.05))


def test_an_accelerometer_of_px4_leads_from_side_to_side() -> None:
    async def play(scene: Scene) -> None:
        task, seen = begin(scene, CalibrationKind.ACCELEROMETER)
        await scene.pass_s(2.0)
        scene.vehicle.report(
            "[cal] calibration started: 2 accel",
            "[cal] pending: back front left right up down",
            "[cal] hold vehicle still on a pending side",
            "[cal] detected rest position, hold still...",
            "[cal] down orientation detected",
            "[cal] Hold still, measuring down side",
        )
        await scene.pass_s(0.1)
        assert seen[-1].sides[Side.LEVEL] is SideState.MEASURING
        scene.vehicle.report(
            "[cal] down side result: [ 1.5294 -0.2218 -11.85",
            "[cal] progress <17>",
            "[cal] down side done, rotate to a different side",
            "[cal] pending: back front left right up",
        )
        await scene.pass_s(0.1)
        assert seen[-1].sides[Side.LEVEL] is SideState.DONE
        assert seen[-1].progress == 0.17
        assert seen[-1].instruction == (
            "put the vehicle nose up or nose down or on its left side or on its right side or upside down, and hold it still"
        )
        scene.vehicle.report("[cal] down side already completed", "[cal] calibration failed: timeout: no motion")
        state = await task
        assert (state.phase, state.reason) == (CalibrationPhase.FAILED, "timeout: no motion")

    over(play)


def test_a_cancelled_task_cancels_it_on_the_vehicle() -> None:
    async def play(scene: Scene) -> None:
        task, _ = begin(scene, CalibrationKind.MAGNETOMETER)
        await scene.pass_s(2.0)
        scene.vehicle.report("[cal] calibration started: 2 mag")
        await scene.pass_s(0.5)
        state = scene.services.calibration.state
        assert state is not None
        assert state.phase is CalibrationPhase.RUNNING
        with pytest.raises(Refused, match="the magnetometer is being calibrated"):
            await scene.services.calibration.run(CalibrationKind.GYRO)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        await scene.pass_s(3.0)
        assert scene.vehicle.requested[-1].params == (0, 0, 0, 0, 0, 0, 0)
        assert scene.services.calibration.state is None

    over(play, Conditions(latency_s=0.05, loss=0.1))


def test_cancel_ends_it_with_that_state() -> None:
    async def play(scene: Scene) -> None:
        task, _ = begin(scene, CalibrationKind.LEVEL)
        await scene.pass_s(2.0)
        scene.services.calibration.cancel()
        assert (await task).phase is CalibrationPhase.CANCELLED

    over(play)


def test_a_vehicle_that_says_no_more_is_given_up() -> None:
    async def play(scene: Scene) -> None:
        task, _ = begin(scene, CalibrationKind.GYRO)
        await scene.pass_s(2.0)
        scene.vehicle.report("[cal] calibration started: 2 gyro", "[cal] progress <95>")
        await scene.pass_s(0.1)
        scene.cut()
        state = await task
        assert state.phase is CalibrationPhase.FAILED
        assert "no message from it for 90 s" in state.reason

    over(play)


def test_an_accelerometer_of_ardupilot_waits_to_be_confirmed() -> None:
    async def play(scene: Scene) -> None:
        task, seen = begin(scene, CalibrationKind.ACCELEROMETER)
        await scene.pass_s(2.0)
        with pytest.raises(Refused, match="does not wait"):
            scene.services.calibration.confirm()
        for position, side in enumerate(Side, start=1):
            for _ in range(3):  # it repeats itself until it is answered
                wanted = {"target_system": 255, "target_component": 0, "command": 42429, "param1": float(position)}
                scene.vehicle.send("COMMAND_LONG", **wanted)
                await scene.pass_s(1.0)
            assert seen[-1].phase is CalibrationPhase.WAITING
            assert seen[-1].instruction == f"put the vehicle {side}, hold it still, and confirm"
            scene.services.calibration.confirm()
            await scene.pass_s(1.0)
            assert seen[-1].sides[side] is SideState.MEASURING
            confirmed = [request.params[0] for request in scene.vehicle.requested if request.command == 42429]
            assert confirmed == list(range(1, position + 1))
        scene.vehicle.send("COMMAND_LONG", target_system=255, command=42429, param1=16777215.0)
        assert (await task).phase is CalibrationPhase.DONE

    over(play, Conditions(latency_s=0.05, loss=0.1), autopilot=ARDUPILOT)


def test_magnetometers_of_ardupilot_are_judged_together() -> None:
    async def play(scene: Scene) -> None:
        task, seen = begin(scene, CalibrationKind.MAGNETOMETER)
        await scene.pass_s(2.0)
        for number, percent in ((0, 20), (1, 40)):
            scene.vehicle.send("MAG_CAL_PROGRESS", compass_id=number, cal_mask=3, cal_status=2, completion_pct=percent)
        await scene.pass_s(0.5)
        assert seen[-1].progress == pytest.approx(0.3)
        scene.vehicle.send("MAG_CAL_REPORT", compass_id=0, cal_mask=3, cal_status=4, autosaved=1)
        await scene.pass_s(0.5)
        assert not task.done()
        scene.vehicle.send("MAG_CAL_REPORT", compass_id=1, cal_mask=3, cal_status=7)
        state = await task
        assert state.phase is CalibrationPhase.FAILED
        assert state.reason == "magnetometer 2 failed: the field is too strong or too weak; is metal nearby?"

    over(play, autopilot=ARDUPILOT)


def test_a_gyro_of_ardupilot_ends_with_the_answer_and_is_not_asked_for_twice() -> None:
    async def play(scene: Scene) -> None:
        task, _ = begin(scene, CalibrationKind.GYRO)
        scene.vehicle.answer = lambda request: CommandResult.IN_PROGRESS if request.command == 241 else None
        await scene.pass_s(4.0)
        (request,) = [one for one in scene.vehicle.requested if one.command == 241]
        scene.vehicle._commands.answer(request, CommandResult.ACCEPTED, now_s=asyncio.get_running_loop().time())
        scene.vehicle.runner.settle()
        assert (await task).phase is CalibrationPhase.DONE
        assert len([one for one in scene.vehicle.requested if one.command == 241]) == 1

    over(play, autopilot=ARDUPILOT)


def test_what_cannot_begin_is_refused_or_failed_with_the_reason() -> None:
    async def play(scene: Scene) -> None:
        calibration = scene.services.calibration
        scene.vehicle.answer = lambda request: CommandResult.DENIED if request.command == 241 else None
        state = await calibration.run(CalibrationKind.LEVEL)
        assert state.phase is CalibrationPhase.FAILED
        assert state.reason.startswith("the vehicle's answer: denied")
        with pytest.raises(Refused, match="nothing is being calibrated"):
            calibration.confirm()
        scene.vehicle.heartbeat.base_mode = 128
        await scene.pass_s(2.0)
        with pytest.raises(Refused, match="the vehicle is armed"):
            await calibration.run(CalibrationKind.GYRO)

    over(play)


def test_a_firmware_that_is_not_known_is_not_calibrated() -> None:
    async def play(scene: Scene) -> None:
        with pytest.raises(Refused, match="calibration of this firmware is not supported"):
            await scene.services.calibration.run(CalibrationKind.GYRO)

    over(play, autopilot=4)
