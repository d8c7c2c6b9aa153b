"""The gimbal behind the onboard process, over UDP: mavsdk's gimbal plugin finds, takes, and steers it, as QGroundControl does."""

import time
from collections.abc import Callable
from contextlib import closing
from math import asin, atan2, degrees
from pathlib import Path
from typing import Any

import pytest
from mavsdk.plugins.gimbal import ControlMode, Gimbal, GimbalError, GimbalMode, SendMode
from tests.onboard.onboard_scene import vehicle
from tests.onboard.qgc_sequences import COMPANION, Station
from tests.sitl.mavsdk_client import Client

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

PLATFORM = """
platform: looker
extends: pelican_rtk
capabilities:
  point_camera: {arguments: point_camera, performed_by: gimbal, claims: [gimbal], needs: [autopilot]}
components:
  - {name: gimbal, class: "gloc3_onboard.components.drivers.gimbal:GimbalDriver", rate_hz: 10, devices: {device: gimbal}, ports: {action_status: action_status/gimbal}}
"""
WITHIN_S = 60.0
DENIED = 2
IN_VEHICLE = 32


def found(gimbal: Gimbal) -> int:
    """The id of the one gimbal, once there is one."""
    end_s = time.monotonic() + WITHIN_S
    while not (gimbals := gimbal.gimbal_list().gimbals) and time.monotonic() < end_s:
        time.sleep(0.1)
    (one,) = gimbals
    assert (one.vendor_name, one.model_name) == ("GLOC3", "simulated gimbal")
    assert (one.gimbal_manager_component_id, one.gimbal_device_id) == (COMPANION, 154)
    return int(one.gimbal_id)


def awaited(qgc: Station, is_it: Callable[[float, float], bool]) -> None:
    """Waits for an attitude: pitch, and yaw from the nose. mavsdk 4.1 crashes where it is asked for one."""

    def fits(message: Any) -> bool:
        if not qgc.kind("GIMBAL_DEVICE_ATTITUDE_STATUS", 154)(message):
            return False
        w, x, y, z = message.q
        pitch, yaw = asin(2.0 * (w * y - z * x)), atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        return message.flags & IN_VEHICLE and is_it(degrees(pitch), degrees(yaw))

    qgc.receive(fits, 3.0, "the attitude")


def test_it_finds_the_gimbal_takes_it_and_steers_it(tmp_path: Path) -> None:
    (tmp_path / "looker.yaml").write_text(PLATFORM)
    with (
        vehicle(tmp_path, simulator=("--gimbal",), platform="looker.yaml") as scene,
        closing(Client(scene.port)) as client,
        closing(Station(scene.port)) as qgc,
    ):
        gimbal = client.plugin(Gimbal)
        number = found(gimbal)
        with pytest.raises(GimbalError):
            gimbal.set_angles(number, 0.0, -10.0, 0.0, GimbalMode.YAW_FOLLOW, SendMode.ONCE)
        gimbal.take_control(number, ControlMode.PRIMARY)
        gimbal.set_angles(number, 0.0, -30.0, 10.0, GimbalMode.YAW_FOLLOW, SendMode.ONCE)
        awaited(qgc, lambda pitch, yaw: abs(pitch + 30.0) < 1.0 and abs(yaw - 10.0) < 1.0)
        gimbal.set_angles(number, 0.0, 20.0, -90.0, GimbalMode.YAW_FOLLOW, SendMode.STREAM)
        awaited(qgc, lambda pitch, yaw: abs(pitch - 20.0) < 1.0 and abs(yaw + 90.0) < 1.0)
        gimbal.set_angular_rates(number, 0.0, -10.0, 0.0, GimbalMode.YAW_FOLLOW, SendMode.ONCE)
        awaited(qgc, lambda pitch, yaw: pitch < 15.0 and abs(yaw + 90.0) < 1.0)
        assert gimbal.get_control_status(number).control_mode is ControlMode.PRIMARY
        about = qgc.request(COMPANION, 280, "GIMBAL_MANAGER_INFORMATION")
        assert about.gimbal_device_id == 154
        status = qgc.receive(qgc.kind("GIMBAL_MANAGER_STATUS", COMPANION), 2.0, "the manager's status")
        assert (status.primary_control_sysid, status.primary_control_compid) == (245, 190)
        configure = (255.0, 190.0, -1.0, -1.0, 0.0, 0.0, 154.0)
        assert qgc.command(COMPANION, 1001, *configure) == DENIED, "mavsdk holds control"
        gimbal.release_control(number)
