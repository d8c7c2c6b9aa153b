"""Cameras and gimbals of vehicles without a companion: MAVSDK's camera server as the camera, a gimbal manager, and neither."""

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from math import isnan

import pytest
from tests.groundstation.services.scripted_vehicle import ARDUPILOT, PX4, Scene, over
from tests.groundstation.services.test_services_with_sitl import at, simulated, until

from gloc3.errors import Refused
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandRequest
from gloc3_groundstation.services.actions import Action
from gloc3_sitl.demo.demo import free_ports

CAMERA = """
import sys
from mavsdk import Configuration, ComponentType, Mavsdk
from mavsdk.plugins.camera_server import CameraFeedback, CameraServer, CaptureInfo, Information, Position, Quaternion
sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.CAMERA))
sdk.add_any_connection("udpout://127.0.0.1:" + sys.argv[1])
camera = CameraServer(sdk.server_component())
camera.set_information(Information("maker", "model", "1.0.0", 3.0, 3.68, 2.76, 640, 480, 0, 0, "", 0, 0))
def taken(index, _):
    print("picture", flush=True)
    place = Position(47.0, 8.0, 488.0, 0.0)
    camera.respond_take_photo(CameraFeedback.OK, CaptureInfo(place, Quaternion(1.0, 0.0, 0.0, 0.0), 0, True, index, ""))
camera.subscribe_take_photo(taken)
def started(stream, _):
    print("record", flush=True)
    camera.respond_start_video(CameraFeedback.OK)
camera.subscribe_start_video(started)
def stopped(stream, _):
    print("stop", flush=True)
    camera.respond_stop_video(CameraFeedback.OK)
camera.subscribe_stop_video(stopped)
sys.stdin.read()
"""


@contextmanager
def camera_server(port: int) -> Iterator[list[str]]:
    """MAVSDK's camera, as component 100 of system 1; what it has said is in the list at the end."""
    said: list[str] = []
    process = subprocess.Popen(
        [sys.executable, "-c", CAMERA, str(port)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        yield said
    finally:
        process.kill()
        said += [line for line in process.communicate(timeout=30)[0].splitlines() if not line.startswith("[")]


@pytest.mark.sockets
async def test_mavsdks_camera_takes_pictures_and_records() -> None:
    (port,) = free_ports(1, socket.SOCK_DGRAM)
    with camera_server(port) as said, simulated("px4", "--link", f"station=udpout://127.0.0.1:{port}"):
        async with at(f"udpin://127.0.0.1:{port}") as (services, link):
            components: set[int] = set()
            unlisten = link.listen(lambda frame: components.add(frame.component))
            await until(lambda: 100 in components)
            for action in (Action.PICTURE, Action.RECORD, Action.STOP_RECORDING):
                await services.actions.act(action)
            unlisten()
    assert said == ["picture", "record", "stop"]


def test_without_a_camera_and_a_gimbal_both_are_refused() -> None:
    async def play(scene: Scene) -> None:
        for action in (Action.PICTURE, Action.RECORD):
            with pytest.raises(Refused, match="it has no camera that answers to MAVLink"):
                await scene.services.actions.act(action)
        assert [request.command for request in scene.vehicle.requested] == [2000, 203, 2500]
        with pytest.raises(Refused, match="it has no gimbal that answers to MAVLink"):
            await scene.services.actions.act(Action.POINT, -30.0, 0.0)
        with pytest.raises(Refused, match="pitch is up to 180, yaw up to 360 degrees"):
            await scene.services.actions.act(Action.POINT, -200.0, 0.0)

    over(play, autopilot=PX4)


def test_an_autopilot_that_only_triggers_a_camera_does_so() -> None:
    async def play(scene: Scene) -> None:
        scene.vehicle.answer = lambda request: CommandResult.ACCEPTED if request.command == 203 else None
        await scene.services.actions.act(Action.PICTURE)
        shot = scene.vehicle.requested[-1]
        assert (shot.command, shot.params[4]) == (203, 1.0)

    over(play, autopilot=ARDUPILOT)


def test_a_gimbal_is_taken_and_pointed_and_its_refusal_is_told() -> None:
    async def play(scene: Scene) -> None:
        results = {1001: CommandResult.ACCEPTED, 1000: CommandResult.ACCEPTED}

        def answer(request: MavCommandRequest) -> CommandResult | None:
            return results.get(request.command)

        scene.vehicle.answer = answer
        await scene.services.actions.act(Action.POINT, -45.0, 20.0)
        taken, pointed = scene.vehicle.requested
        assert (taken.command, taken.params[:4]) == (1001, (255.0, 190.0, -1.0, -1.0))
        assert (pointed.command, pointed.params[:2], pointed.params[4]) == (1000, (-45.0, 20.0), 0.0)
        assert isnan(pointed.params[2])
        assert isnan(pointed.params[3])
        await scene.pass_s(5.0)
        results[1001] = CommandResult.DENIED
        with pytest.raises(Refused, match="its gimbal: "):
            await scene.services.actions.act(Action.POINT, 0.0, 0.0)

    over(play, autopilot=ARDUPILOT)
