"""What a vehicle says of itself is asked for once, and what it does not tell is not waited for again and again."""

import asyncio

import pytest

from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.parameter import ParameterEncoding
from gloc3.mavlink.services.version import ProtocolCapability, Version
from gloc3_groundstation.services.snapshot import Firmware, ServicesSnapshot

from .scripted_vehicle import ARDUPILOT, PX4, VEHICLE, Scene, over


@pytest.mark.parametrize(
    ("firmware", "capabilities", "encoding"),
    [
        (Firmware.PX4, None, ParameterEncoding.BYTEWISE),
        (Firmware.ARDUPILOT, None, ParameterEncoding.CAST),
        (Firmware.ARDUPILOT, ProtocolCapability.PARAM_ENCODE_BYTEWISE, ParameterEncoding.BYTEWISE),
        (Firmware.PX4, ProtocolCapability.PARAM_ENCODE_C_CAST, ParameterEncoding.CAST),
        (Firmware.PX4, ProtocolCapability.PARAM_FLOAT, ParameterEncoding.BYTEWISE),
        (Firmware.OTHER, ProtocolCapability.PARAM_FLOAT, ParameterEncoding.CAST),
    ],
)
def test_integers_travel_as_the_vehicle_says_or_else_as_its_firmware_does(
    firmware: Firmware, capabilities: ProtocolCapability | None, encoding: ParameterEncoding
) -> None:
    version = None if capabilities is None else Version(capabilities=capabilities)
    assert ServicesSnapshot(address=VEHICLE, firmware=firmware, version=version).encoding is encoding


@pytest.mark.parametrize("answer", [CommandResult.UNSUPPORTED, CommandResult.ACCEPTED])
def test_a_vehicle_that_does_not_tell_its_version_is_served_without_waiting_each_time(answer: CommandResult) -> None:
    async def play(scene: Scene) -> None:
        loop = asyncio.get_running_loop()
        scene.vehicle.answer = lambda request: answer if request.command == 512 else None
        assert len(await scene.services.parameters.fetch()) == 40
        first_s = loop.time()
        assert first_s < 7.0
        assert len(await scene.services.parameters.fetch()) == 40
        assert loop.time() - first_s < 1.0
        assert scene.services.snapshots.version is None
        assert scene.services.snapshots.title == "ArduPilot, system 1"

    over(play, autopilot=ARDUPILOT)


def test_what_the_heartbeat_says_is_followed() -> None:
    async def play(scene: Scene) -> None:
        snapshot = await scene.services.learn()
        assert (snapshot.firmware, snapshot.vehicle_type, snapshot.is_armed) == (Firmware.PX4, 2, False)
        scene.vehicle.heartbeat.base_mode = 128
        await scene.pass_s(1.5)
        assert scene.services.snapshots.is_armed

    over(play, autopilot=PX4)
