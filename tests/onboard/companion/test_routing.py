"""An unmodified mavsdk client behind the onboard process reaches the autopilot and the companion over one link."""

import socket
import time
from pathlib import Path

import pytest
from mavsdk.plugins.param import Param
from pymavlink import mavutil
from tests.commands.programs import program
from tests.sitl.mavsdk_client import Client, item

from gloc3.log.reader import LogReader
from gloc3.mavlink.codec import Frame, Parser
from gloc3_sitl.demo.demo import free_ports

pytestmark = [pytest.mark.sockets, pytest.mark.thorough]

WAYPOINT, TAKE_OFF = 16, 22


def test_stations_of_others_reach_the_autopilot_through_the_onboard_process(tmp_path: Path) -> None:
    port, first, second = free_ports(3, socket.SOCK_DGRAM)
    stations = [word for each in (first, second) for word in ("--station", f"udpin://127.0.0.1:{each}")]
    with (
        program("sitl", "--link", f"companion=udpout://127.0.0.1:{port}", folder=tmp_path),
        program(
            *("onboard", "pelican_rtk", "--autopilot", f"udpin://127.0.0.1:{port}"),
            *(*stations, "--out", "out"),
            folder=tmp_path,
        ) as onboard,
    ):
        onboard.await_line(lambda line: "components; log in" in line)
        items = [item(0, TAKE_OFF), *(item(seq, WAYPOINT, north_m=float(seq)) for seq in range(1, 40))]
        one, other = Client(first), Client(second)
        try:
            one.await_armable()
            one.mission.upload_mission(items)
            read = other.mission.download_mission()
            assert [(row.command, row.x, row.y) for row in read] == [(row.command, row.x, row.y) for row in items]
            written, wanted = Param(other.system), Param(one.system)
            written.set_param_float("MPC_XY_VEL_MAX", 7.5)
            assert wanted.get_param_float("MPC_XY_VEL_MAX") == 7.5
            for plugin in (written, wanted):
                plugin.destroy()
            assert {191, 1} <= set(one.system.component_ids()), "companion and autopilot, as one vehicle"
        finally:
            one.close()
            other.close()
        onboard.interrupt()
        assert onboard.end() == 0, onboard.text
    kept = read_back(tmp_path / "out" / "log.tlog")
    assert {(1, 1), (1, 191), (245, 190)} <= {(frame.system, frame.component) for frame in kept}
    companion = {frame.shape.name for frame in kept if frame.sender == (1, 191) and frame.shape is not None}
    assert {"HEARTBEAT", "TUNNEL"} <= companion
    with LogReader(tmp_path / "out" / "log.mcap") as reader:
        logged = list(reader.frames())
    assert [frame.data for frame in logged] == [frame.raw for frame in kept], "both logs hold the same frames"
    assert {frame.direction for frame in logged} == {"in", "out"}


def read_back(path: Path) -> list[Frame]:
    """The frames of a `.tlog`, read by pymavlink, which refuses what is no frame."""
    source = mavutil.mavlogfile(str(path))
    raw = []
    try:
        while (found := source.recv_msg()) is not None:
            assert abs(found._timestamp - time.time()) < 120.0
            raw.append(bytes(found.get_msgbuf()))
    finally:
        source.close()
    return Parser().receive(b"".join(raw))
