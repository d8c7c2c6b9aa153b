"""Every service against the simulated vehicle in its own process, over UDP, in the manners of PX4 and of ArduPilot."""

import asyncio
import re
import subprocess
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

import pytest

from gloc3.errors import Refused
from gloc3.mavlink.codec import message
from gloc3.mavlink.parser import Frame
from gloc3.mavlink.services.calibration import CalibrationKind, CalibrationPhase, CalibrationState
from gloc3.mavlink.services.plan import PlanType
from gloc3.mission.formats.items import FenceArea, ForeignPlan, MavItem, PlanEntry
from gloc3_groundstation.assembly import GroundStation, StationSetup
from gloc3_groundstation.links.link import StationLinkCore
from gloc3_groundstation.services.parameter_table import ParameterChange
from gloc3_groundstation.services.progress import JobProgress
from gloc3_groundstation.services.snapshot import Firmware
from gloc3_groundstation.services.vehicle import VehicleServices

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

PROGRAM = "import sys; from gloc3_sitl.cli.sitl import app; sys.exit(app(sys.argv[1:], result_action='return_value'))"
FIRMWARES = {"px4": Firmware.PX4, "ardupilot": Firmware.ARDUPILOT}
ACTION_PARAMETER = {"px4": "NAV_DLL_ACT", "ardupilot": "FS_GCS_ENABLE"}
PLAN = ForeignPlan(
    entries=tuple(
        PlanEntry(items=(item,))
        for item in (
            MavItem(command=22, frame=3, params=(0.0, 0.0, 0.0, None), x=47.3977, y=8.5456, z=3.0),
            MavItem(command=16, frame=3, params=(0.0, 0.0, 0.0, None), x=47.39775, y=8.5456, z=4.0),
            MavItem(command=177, frame=2, params=(2.0, 1.0, 0.0, 0.0)),
            MavItem(command=20, frame=2),
        )
    ),
    fence=(FenceArea(is_inclusion=True, center=(47.3977, 8.5456), radius_m=200.0),),
    rally=((47.39772, 8.54562, 20.0),),
    home=(47.3977, 8.5456, 488.0),
    raw={},
)


@contextmanager
def simulated(style: str, *options: str) -> Iterator[int]:
    """A simulated vehicle in a process of its own; the port of its link."""
    process = subprocess.Popen(
        [
            *(sys.executable, "-c", PROGRAM, "--world", "open", "--home", "47.3977,8.5456,488.0,0", *options),
            *("--autopilot", style, "--speed", "4", "--link", "station=udpin://127.0.0.1:0"),
        ],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stderr is not None
        yield next(int(found[1]) for line in process.stderr if (found := re.search(r"port (\d+)", line)))
    finally:
        process.terminate()
        process.communicate(timeout=60)


@pytest.fixture(scope="module", params=sorted(FIRMWARES))
def vehicle(request: pytest.FixtureRequest) -> Iterator[tuple[str, int]]:
    """A simulated vehicle for all tests of one style: its style and the port of its link."""
    with simulated(request.param) as port:
        yield request.param, port


async def until(is_so: Callable[[], bool], within_s: float = 60.0) -> None:
    async with asyncio.timeout(within_s):
        while not is_so():
            await asyncio.sleep(0.02)


@asynccontextmanager
async def at(url: str) -> AsyncIterator[tuple[VehicleServices, StationLinkCore]]:
    """The services of the autopilot on a link."""
    ground = GroundStation(StationSetup(boot=1))
    links = ground.links
    try:
        await ground.open([url])
        await until(lambda: bool(links.autopilots()))
        link, target = links.autopilots()[0]
        services = VehicleServices(link, target)
        try:
            yield services, link
        finally:
            await services.close()
    finally:
        await ground.close()


@asynccontextmanager
async def at_hand(port: int) -> AsyncIterator[tuple[VehicleServices, StationLinkCore]]:
    """Those of the simulated vehicle."""
    async with at(f"udpout://127.0.0.1:{port}") as found:
        yield found


async def test_parameters_are_listed_changed_and_refused(vehicle: tuple[str, int], tmp_path: Path) -> None:
    style, port = vehicle
    async with at_hand(port) as (services, _):
        seen: list[JobProgress] = []
        table = await services.parameters.fetch(seen.append)
        assert services.snapshots.firmware is FIRMWARES[style]
        assert len(table) > 60
        assert seen[-1].fraction == 1.0
        name = ACTION_PARAMETER[style]
        first = table[name].value
        await services.parameters.set(name, 2)
        with pytest.raises(Refused, match=f"{name} was not set: the vehicle keeps another value .2."):
            await services.parameters.set(name, 77)
        file = tmp_path / "all.params"
        services.parameters.save(file)
        await services.parameters.set(name, 1)
        diff = services.parameters.compare(file)
        assert diff.changes() == (ParameterChange(name, 2.0),)
        report = await services.parameters.write((*diff.changes(), ParameterChange(name, first)))
        assert report.refused == {}


async def test_parameters_are_described_by_the_vehicle_or_by_what_is_shipped(vehicle: tuple[str, int]) -> None:
    style, port = vehicle
    async with at_hand(port) as (services, _):
        table = await services.parameters.fetch()
        row = table[ACTION_PARAMETER[style]]
        assert "return" in row.info.values.values()
        assert row.info.origin.startswith(f"GLOC3's table for {FIRMWARES[style]}")
        if style == "px4":
            assert await services.parameters.fetch_infos() == len(table)
            assert services.parameters.table[row.name].info.origin == ""
            assert services.parameters.table["COM_DL_LOSS_T"].info.unit == "s"
        else:
            with pytest.raises(Refused, match="offers no component metadata"):
                await services.parameters.fetch_infos()


async def test_the_shell_of_px4_is_typed_into_and_ardupilot_has_none(vehicle: tuple[str, int]) -> None:
    style, port = vehicle
    async with at_hand(port) as (services, _):
        if style == "ardupilot":
            with pytest.raises(Refused, match="ArduPilot has no shell"):
                await services.console.open()
            return
        await services.console.run("ver all")
        await services.console.run("reboot now")
        lines = services.console.text.lines
        assert "FW version: 1.16.0" in lines
        assert "nsh: reboot: command not found" in lines


async def test_a_motor_turns_by_itself_and_stops(vehicle: tuple[str, int]) -> None:
    style, port = vehicle
    async with at_hand(port) as (services, link):
        pulses: list[tuple[int, ...]] = []

        def listen(frame: Frame) -> None:
            if (one := frame.decode()) is not None and one.name == "SERVO_OUTPUT_RAW":
                pulses.append(tuple(getattr(one, f"servo{number}_raw") for number in (1, 2, 3, 4)))

        link.listen(listen)
        await services.rates.request("SERVO_OUTPUT_RAW", 50.0)
        await services.motors.run(2)
        await until(lambda: pulses[-1] == (1000,) * 4)
        assert (1000, 1100, 1000, 1000) in pulses
        assert set(pulses) == {(1000,) * 4, (1000, 1100, 1000, 1000)}
        if style == "px4":
            await services.parameters.fetch()
            await services.parameters.set("COM_MOT_TEST_EN", 0)
            with pytest.raises(Refused, match="COM_MOT_TEST_EN must be 1"):
                await services.motors.run(2)
            await services.parameters.set("COM_MOT_TEST_EN", 1)


STICKS = {"roll": 1, "pitch": 2, "throttle": 3, "yaw": 4}
RC_PARAMETERS = {
    "px4": {"RC1_MIN": 1100, "RC1_TRIM": 1500, "RC2_REV": -1, "RC3_TRIM": 1100, "RC_MAP_YAW": 4, "RC_CHAN_CNT": 4},
    "ardupilot": {"RC1_MIN": 1100, "RC1_TRIM": 1500, "RC3_TRIM": 1100, "RC4_MAX": 1900},
}


async def test_a_transmitter_is_calibrated_and_none_is_refused(vehicle: tuple[str, int]) -> None:
    style, port = vehicle
    async with at_hand(port) as (services, _):
        said = await services.calibration.run(CalibrationKind.RADIO)
        assert "no receiver is heard" in said.reason
        pulses = dict.fromkeys(STICKS.values(), 1500) | {3: 1100}

        async def transmit() -> None:
            while True:
                fields = {f"chan{number}_raw": pulse for number, pulse in pulses.items()}
                services.send(message("RC_CHANNELS_OVERRIDE", target_system=1, target_component=1, **fields))
                await asyncio.sleep(0.05)

        seen = [said]
        transmitter = asyncio.ensure_future(transmit())
        running = asyncio.ensure_future(services.calibration.run(CalibrationKind.RADIO, seen.append))

        async def asked(words: str) -> None:
            await until(lambda: words in seen[-1].instruction)

        if style == "px4":
            await asked("centre the sticks, the throttle down")
            services.calibration.confirm()
            for stick, moved_us in (("throttle", 1900), ("yaw", 1900), ("roll", 1900), ("pitch", 1100)):
                await asked(f"move the {stick} stick")
                pulses[STICKS[stick]] = moved_us
            await until(lambda: "to their ends" in seen[-1].instruction)
        await asked("to their ends")
        for end_us in (1100, 1900):
            pulses.update(dict.fromkeys(pulses, end_us))
            await until(lambda: {one.value_us for one in seen[-1].channels} == set(pulses.values()))
        services.calibration.confirm()
        pulses.update(dict.fromkeys(pulses, 1500) | {3: 1100})
        await until(lambda: [one.value_us for one in seen[-1].channels] == [1500, 1500, 1100, 1500])
        services.calibration.confirm()
        await asked("confirm to write")
        services.calibration.confirm()
        assert (await running).phase is CalibrationPhase.DONE
        transmitter.cancel()
        await services.parameters.fetch()
        assert {name: services.parameters.table[name].value for name in RC_PARAMETERS[style]} == RC_PARAMETERS[style]


async def test_escs_are_calibrated_by_either_firmware(vehicle: tuple[str, int]) -> None:
    style, port = vehicle
    async with at_hand(port) as (services, _):
        seen: list[CalibrationState] = []

        def command(number: int, *params: float) -> None:
            fields = {f"param{index}": value for index, value in enumerate(params, start=1)}
            services.send(message("COMMAND_LONG", target_system=1, target_component=1, command=number, **fields))

        if style == "px4":
            state = await services.calibration.run(CalibrationKind.ESC)
            assert "isconnect" in state.reason, "the battery is connected"
            await services.parameters.fetch()
            await services.parameters.set("SYS_FAILURE_EN", 1)
            command(420, 100, 1)  # the battery is taken off
            await asyncio.sleep(0.5)
        running = asyncio.ensure_future(services.calibration.run(CalibrationKind.ESC, seen.append))
        if style == "px4":
            await until(lambda: bool(seen) and seen[-1].instruction == "Connect battery now")
            command(420, 100, 0)
        else:
            await until(lambda: bool(seen) and seen[-1].phase is CalibrationPhase.WAITING)
            assert services.parameters.table["ESC_CALIBRATION"].value == 3
            services.calibration.confirm()
            await until(lambda: "still 3" in seen[-1].instruction)
            command(246, 1)
            while not running.done():
                services.calibration.confirm()
                await asyncio.sleep(0.5)
        assert (await asyncio.wait_for(running, 30.0)).phase is CalibrationPhase.DONE


async def test_a_plan_is_uploaded_verified_downloaded_and_cleared(vehicle: tuple[str, int], tmp_path: Path) -> None:
    async with at_hand(vehicle[1]) as (services, _):
        seen: list[JobProgress] = []
        assert await services.plans.upload(PLAN, seen.append) == ()
        assert {"uploading the mission", "uploading the fence", "reading the rally points back"} <= {
            p.what for p in seen
        }
        found = await services.plans.download()
        assert found.summary == "4 items, 1 fence area, 1 rally point"
        assert found.plan.items[2].params[:2] == (2.0, 1.0)
        for name in ("down.plan", "down.waypoints"):
            services.plans.save(found, tmp_path / name)
            assert len(services.plans.read(tmp_path / name).items) == 4, "item 0 of a file of waypoints is home"
        assert await services.plans.verify(services.plans.read(tmp_path / "down.plan")) == ()
        assert await services.plans.upload(services.plans.read(tmp_path / "down.waypoints")) == ()
        assert (await services.plans.download()).summary == "4 items, 1 fence area, 1 rally point"
        await services.plans.clear(PlanType.FENCE)
        (difference,) = await services.plans.verify(PLAN)
        assert str(difference) == "fence item 0: 1 item wanted, 0 there"
        assert await services.plans.upload(ForeignPlan(entries=(), raw={}), kinds=tuple(PlanType)) == ()
        assert (await services.plans.download()).summary == "0 items, 0 fence areas, 0 rally points"


async def test_a_plan_that_the_vehicle_does_not_take_is_refused_in_words(vehicle: tuple[str, int]) -> None:
    bad = ForeignPlan(entries=(*PLAN.entries, PlanEntry(items=(MavItem(command=31_999, frame=2),))), raw={})
    async with at_hand(vehicle[1]) as (services, _):
        with pytest.raises(Refused, match=r"the mission was not uploaded: item [0-9]+, .*: an item's command"):
            await services.plans.upload(bad)


async def test_a_gyro_is_calibrated_and_rates_are_measured(vehicle: tuple[str, int]) -> None:
    async with at_hand(vehicle[1]) as (services, _):
        assert (await services.calibration.run(CalibrationKind.GYRO)).phase is CalibrationPhase.DONE
        await services.rates.request("ATTITUDE", 10.0)
        await until(lambda: any(row.rate_hz > 5.0 for row in services.rates.table.find("ATTITUDE")))
        with pytest.raises(Refused, match="RAW_RPM"):
            await services.rates.request("RAW_RPM", 5.0)


async def test_the_log_of_an_armed_vehicle_is_listed_and_downloaded_both_ways(
    vehicle: tuple[str, int], tmp_path: Path
) -> None:
    async with at_hand(vehicle[1]) as (services, link):
        async with asyncio.timeout(90.0):
            while not services.snapshots.is_armed:
                link.send(message("COMMAND_LONG", target_system=1, target_component=1, command=400, param1=1.0))
                await asyncio.sleep(0.2)
        await until(lambda: not services.snapshots.is_armed)
        (line, *_) = await services.logs.list()
        path = await services.logs.download(line, tmp_path)
        assert path.stat().st_size == line.entry.size > 0
        folder = await services.files.list("/fs/microsd/log" if vehicle[0] == "px4" else "/APM/LOGS")
        copy = await services.files.download(folder.path_of(folder.entries[-1]), tmp_path / "copy")
        assert copy.read_bytes() == path.read_bytes()
        with pytest.raises(Refused, match="cannot be removed"):
            await services.files.remove("/fs/none")
