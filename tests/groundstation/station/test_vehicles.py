"""Vehicles by what the links hear: bare ones appear with their state, platforms get their autopilots, doubles are told."""

import asyncio

import pytest
from tests.groundstation.vehicles_scene import ARDUPILOT, BRAKE, PX4, SMARTAP, Autopilot, Scene, over

from gloc3.errors import Refused
from gloc3.mavlink.codec import Parser, shape
from gloc3.mavlink.message import Address
from gloc3.messages.command_interface import EmergencyVerb
from gloc3.messages.envelope import Severity
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.autopilot_desk import values_of
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.desk.go_here import go_to_request
from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.desk.services_desk import ServicesDesk
from gloc3_groundstation.mapping.ground import Ground
from gloc3_groundstation.services.actions import Action
from gloc3_groundstation.services.progress import OnProgress
from gloc3_groundstation.station import alerts
from gloc3_groundstation.station.alerts import Alerts
from gloc3_groundstation.station.readings import MESSAGES as READINGS
from gloc3_groundstation.station.readings import WANTED_HZ
from gloc3_groundstation.station.vehicles import RESTARTED


def test_a_bare_autopilot_appears_with_mode_arming_battery_and_place() -> None:
    async def play(scene: Scene) -> None:
        autopilot = Autopilot(scene.memories[0], ARDUPILOT, custom_mode=BRAKE, base_mode=128)
        await scene.pass_s(1.5)
        autopilot.report("SYS_STATUS", battery_remaining=64)
        autopilot.report("EXTENDED_SYS_STATE", landed_state=2)
        await scene.pass_s(2.0)
        autopilot.report("GLOBAL_POSITION_INT", lat=473977000, lon=85456000, alt=500_000, relative_alt=12_000, hdg=9000)
        await scene.pass_s(1.0)
        bare = scene.platform("ardupilot-1")
        assert bare.vehicle is not None
        vehicle = bare.vehicle.value
        assert (vehicle.mode, vehicle.is_armed, vehicle.battery_percent) == ("BRAKE", True, 64)
        assert (vehicle.landed, vehicle.heading_deg, vehicle.geo) == ("in_air", 90, (47.3977, 8.5456, 500.0))
        assert not bare.has_companion
        wire, address = scene.vehicles.reach("ardupilot-1")
        assert (wire.best, address) == (scene.links[0][1], Address(1, 1))
        text = "is heard: ArduPilot quadrotor, system 1, without a GLOC3 companion: commanded through its autopilot"
        assert scene.texts() == [text]
        assert list(alerts.causes(scene.station.fleet, scene.station.now_s())) == []
        autopilot.is_on = False
        await scene.pass_s(6.0)
        assert scene.platform("ardupilot-1").is_quiet_link(scene.station.now_s())
        autopilot.is_on = True
        await scene.pass_s(2.0)
        assert "is heard again after 7 s of silence" in scene.texts()

    over(play)


def test_a_heading_that_the_autopilot_does_not_know_is_not_taken_for_north() -> None:
    async def play(scene: Scene) -> None:
        autopilot = Autopilot(scene.memories[0], ARDUPILOT)
        await scene.pass_s(4.0)
        autopilot.report("GLOBAL_POSITION_INT", lat=473977000, lon=85456000, alt=500_000, hdg=65_535)
        await scene.pass_s(1.0)
        vehicle = scene.platform("ardupilot-1").vehicle
        assert vehicle is not None
        assert vehicle.value.heading_deg == -1

    over(play)


@pytest.mark.parametrize("raised_m", [0.4, 60.0])
def test_heights_of_a_bare_vehicle_count_from_where_its_home_is_now(raised_m: float) -> None:
    async def play(scene: Scene) -> None:
        autopilot = Autopilot(scene.memories[0], PX4, base_mode=128)
        await scene.pass_s(4.0)
        place = {"lat": 473977000, "lon": 85456000, "alt": 600_000}
        for above_m in (100.0, 100.0 - raised_m):
            autopilot.report("GLOBAL_POSITION_INT", relative_alt=round(1000 * above_m), **place)
            await scene.pass_s(1.0)
        bare = scene.platform("px4-1")
        assert bare.vehicle is not None
        assert bare.vehicle.value.position_m[2] == pytest.approx(100.0 - raised_m)
        altitude_m = values_of(Action.GO_TO, "47.398, 8.5456, 10", bare)[2]
        assert altitude_m == pytest.approx(500.0 + raised_m + 10.0)
        request = go_to_request(Desk(scene.station), bare, Ground(bare), 10.0, 0.0)
        assert request.height_m == pytest.approx(100.0 - raised_m)

    over(play)


def test_what_a_bare_autopilot_says_is_an_event_and_repeats_and_other_routes_are_not() -> None:
    async def play(scene: Scene) -> None:
        routes = [Autopilot(memory, ARDUPILOT) for memory in scene.memories]
        await scene.pass_s(5.0)
        for _ in range(3):
            for autopilot in routes:
                autopilot.report("STATUSTEXT", severity=4, text="PreArm: Compass not healthy")
            await scene.pass_s(1.0)
        routes[0].report("STATUSTEXT", severity=2, text="Crash: Disarming: AngErr=77>30, Accel=0.3<3.0, and", id_=7)
        routes[0].report("STATUSTEXT", severity=2, text=" more", id_=7, chunk_seq=1)
        await scene.pass_s(1.0)
        said = [(one.severity, one.text) for one in scene.station.fleet.events if "says" in one.text]
        assert said == [
            (Severity.WARNING, "the autopilot says: PreArm: Compass not healthy"),
            (Severity.CRITICAL, "the autopilot says: Crash: Disarming: AngErr=77>30, Accel=0.3<3.0, and more"),
        ]
        await scene.pass_s(40.0)
        routes[0].report("STATUSTEXT", severity=4, text="PreArm: Compass not healthy")
        await scene.pass_s(1.0)
        assert len([text for text in scene.texts() if "Compass" in text]) == 2

    over(play)


def test_what_the_autopilot_of_a_companion_says_is_passed_on_by_that_alone() -> None:
    async def play(scene: Scene) -> None:
        autopilot = Autopilot(scene.memories[0], PX4)
        tunnel = scene.companion(0)
        await scene.pass_s(5.0)
        autopilot.report("STATUSTEXT", severity=4, text="low battery")
        await scene.pass_s(1.0)
        assert not [text for text in scene.texts() if "says" in text]
        tunnel.close()

    over(play)


def test_a_bare_vehicle_gets_no_commands_and_says_so() -> None:
    async def play(scene: Scene) -> None:
        Autopilot(scene.memories[0], PX4)
        await scene.pass_s(4.0)
        desk = Desk(scene.station)
        assert desk.moves(scene.platform("px4-1")) == frozenset()
        assert not await desk.emergency("px4-1", EmergencyVerb.HOLD)
        (*_, event) = scene.station.fleet.events
        assert (event.severity, event.text) == (Severity.ERROR, "hold: this station has no link to px4-1")
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(2.0):
                await flights.await_platform(scene.station, None)

    over(play)


def test_a_platform_gets_its_own_autopilot_and_no_bare_vehicle_is_shown_beside_it() -> None:
    async def play(scene: Scene) -> None:
        Autopilot(scene.memories[0], PX4)
        tunnel = scene.companion(0)
        await scene.pass_s(6.0)
        assert list(scene.station.fleet.platforms) == ["heron"]
        autopilot = scene.platform("heron").autopilot
        assert autopilot is not None
        assert (autopilot.firmware, autopilot.system, autopilot.link) == ("PX4", 1, "udpin://0.0.0.0:14550")
        wire, address = scene.vehicles.reach("heron")
        assert (wire.best, address) == (scene.links[0][1], Address(1, 1))
        tunnel.close()

    over(play)


def test_a_companion_that_comes_late_takes_the_bare_vehicles_place() -> None:
    async def play(scene: Scene) -> None:
        Autopilot(scene.memories[0], PX4)
        await scene.pass_s(5.0)
        assert list(scene.station.fleet.platforms) == ["px4-1"]
        tunnel = scene.companion(0)
        await scene.pass_s(4.0)
        assert list(scene.station.fleet.platforms) == ["heron"]
        assert "was shown as px4-1 so far" in scene.texts()
        assert scene.station.fleet.renamed == {"px4-1": "heron"}
        tunnel.close()

    over(play)


def test_a_platform_whose_autopilot_is_not_heard_is_refused_with_a_hint() -> None:
    async def play(scene: Scene) -> None:
        tunnel = scene.companion(0)
        await scene.pass_s(3.0)
        with pytest.raises(Refused, match="no link of this station hears the autopilot of heron; --link"):
            scene.vehicles.reach("heron")
        tunnel.close()

    over(play)


def test_two_vehicles_of_one_system_id_on_two_links_are_told_and_each_is_reached_by_its_link() -> None:
    async def play(scene: Scene) -> None:
        Autopilot(scene.memories[0], PX4)
        await scene.pass_s(7.5)
        Autopilot(scene.memories[1], PX4)
        await scene.pass_s(5.0)
        assert list(scene.station.fleet.platforms) == ["px4-1", "px4-1@2"]
        assert scene.vehicles.reach("px4-1")[0].best is scene.links[0][1]
        assert scene.vehicles.reach("px4-1@2")[0].best is scene.links[1][1]
        reported = alerts.update(Alerts(), scene.station.fleet, scene.station.now_s()).pending
        assert [(alert.platform, alert.what) for alert in reported] == [
            ("px4-1", "same system id"),
            ("px4-1@2", "same system id"),
        ]
        assert reported[0].text.startswith(
            "px4-1@2 on udpin://0.0.0.0:14551 has the same system id 1: each is addressed"
        )

    over(play)


def test_one_vehicle_on_two_links_is_one_and_is_reached_by_the_one_that_is_left() -> None:
    async def play(scene: Scene) -> None:
        first, second = (Autopilot(memory, PX4) for memory in scene.memories)
        await scene.pass_s(5.0)
        assert list(scene.station.fleet.platforms) == ["px4-1"]
        assert scene.vehicles.reach("px4-1")[0].best is scene.links[0][1]
        first.is_on = False
        await scene.pass_s(6.0)
        assert scene.vehicles.reach("px4-1")[0].best is scene.links[1][1]
        assert not scene.platform("px4-1").is_quiet_link(scene.station.now_s())
        assert second.is_on

    over(play)


def test_what_is_sent_by_one_link_is_answered_by_any_and_heard_once() -> None:
    async def play(scene: Scene) -> None:
        one, other = (Autopilot(memory, PX4) for memory in scene.memories)
        await scene.pass_s(8.0)
        wire, _ = scene.vehicles.reach("px4-1")
        heard: list[str] = []
        wire.listen(lambda frame: heard.append(frame.shape.name if frame.shape is not None else ""))
        other.report("COMMAND_ACK", command=400)
        await scene.pass_s(0.2)
        assert heard.count("COMMAND_ACK") == 1
        one.report("PARAM_VALUE", other, param_id="A")
        one.report("PARAM_VALUE", other, param_id="A")
        await scene.pass_s(0.2)
        assert heard.count("PARAM_VALUE") == 2
        one.is_on = False
        await scene.pass_s(6.0)
        assert wire.best is scene.links[1][1], "the link on which it is heard now"
        assert scene.vehicles.reach("px4-1")[0] is wire, "what was loaded stays"

    over(play)


def test_two_vehicles_of_one_system_id_on_one_link_are_told_and_a_restart_is_not() -> None:
    async def play(scene: Scene) -> None:
        first = Autopilot(scene.memories[0], PX4)
        await scene.pass_s(20.0)
        first.booted_s = asyncio.get_running_loop().time()
        await scene.pass_s(3.0)
        assert scene.platform("px4-1").problems == ()
        await scene.pass_s(8.5)
        assert [text for text in scene.texts() if "restarted" in text] == [RESTARTED]
        Autopilot(scene.memories[0], PX4)
        await scene.pass_s(5.0)
        (problem,) = scene.platform("px4-1").problems
        assert scene.texts().count(RESTARTED) == 1
        assert problem.text.startswith("two vehicles share system id 1 on udpin://0.0.0.0:14550: both obey; give one")

    over(play)


@pytest.mark.parametrize("booted_s", [0.0, 30.0])
def test_another_vehicle_with_the_address_of_one_before_inherits_nothing(booted_s: float) -> None:
    async def play(scene: Scene) -> None:
        await scene.pass_s(10.0)
        autopilot = Autopilot(scene.memories[0], PX4)
        await scene.pass_s(5.0)
        autopilot.report("HOME_POSITION", latitude=473977000, longitude=85456000, altitude=500_000)
        autopilot.report("GLOBAL_POSITION_INT", lat=473977000, lon=85456000, alt=500_000, time_boot_ms=5000)
        await scene.pass_s(1.0)
        services = ServicesDesk(scene.station, scene.vehicles.reach)
        before = services.vehicle("px4-1")
        assert before.motors.confirm("props off", "px4-1") == ""
        assert before.motors.is_confirmed
        autopilot.is_on = False
        await scene.pass_s(14.0)
        assert not before.motors.is_confirmed
        autopilot.booted_s, autopilot.is_on = booted_s, True
        await scene.pass_s(6.0)
        snapshot = scene.platform("px4-1").autopilot
        assert snapshot is not None
        assert snapshot.home_geo is None
        place = {"lat": 474077000, "lon": 85456000, "alt": 1600_000}
        autopilot.report("GLOBAL_POSITION_INT", time_boot_ms=int(1000 * (36.0 - booted_s)), **place)
        await scene.pass_s(1.0)
        site = scene.platform("px4-1").site
        assert site is not None
        assert site.value.origin_geo == (47.4077, 8.5456, 1600.0)
        after = services.vehicle("px4-1")
        assert after is not before, "nothing that was loaded from the other one is shown"
        await scene.pass_s(1.0)
        assert services.vehicle("px4-1") is after
        assert scene.texts().count(RESTARTED) == 1
        await services.close()

    over(play)


def test_a_calibration_goes_on_over_the_restart_that_it_asks_for() -> None:
    async def play(scene: Scene) -> None:
        autopilot = Autopilot(scene.memories[0], PX4)
        await scene.pass_s(10.0)
        services = ServicesDesk(scene.station, scene.vehicles.reach)
        before, ended = services.vehicle("px4-1"), asyncio.Event()

        async def calibrated(report: OnProgress) -> str:
            await ended.wait()
            return "ESC: calibrated"

        before.begin(ServiceKind.CALIBRATION, "calibrating the ESC", calibrated)
        autopilot.booted_s = asyncio.get_running_loop().time()
        await scene.pass_s(10.0)
        assert services.vehicle("px4-1") is before
        ended.set()
        await scene.pass_s(2.0)
        assert before.jobs.outcomes[ServiceKind.CALIBRATION].text == "ESC: calibrated"
        assert services.vehicle("px4-1") is not before
        await scene.pass_s(1.0)
        await services.close()

    over(play)


def test_a_link_that_gets_late_is_no_restart() -> None:
    async def play(scene: Scene) -> None:
        autopilot = Autopilot(scene.memories[0], PX4)
        await scene.pass_s(20.5)
        services = ServicesDesk(scene.station, scene.vehicles.reach)
        before = services.vehicle("px4-1")
        autopilot.is_on = False
        await scene.pass_s(3.0)
        autopilot.booted_s, autopilot.is_on = 3.0, True
        await scene.pass_s(8.0)
        assert services.vehicle("px4-1") is before
        assert RESTARTED not in scene.texts()
        await services.close()

    over(play)


def test_a_vehicle_that_has_restarted_is_asked_again_for_what_it_does_not_tell() -> None:
    async def play(scene: Scene) -> None:
        requested: list[int] = []

        def handle(data: bytes) -> None:
            requested.extend(frame.message_id for frame in Parser(is_datagram=True).receive(data))

        scene.memories[0].b.on_data = handle
        autopilot = Autopilot(scene.memories[0], PX4)
        await scene.pass_s(60.0)
        requested.clear()
        autopilot.booted_s = asyncio.get_running_loop().time()
        await scene.pass_s(10.0)
        assert shape("COMMAND_LONG").id in requested

    over(play)


def test_an_unknown_autopilot_says_what_is_the_matter() -> None:
    async def play(scene: Scene) -> None:
        Autopilot(scene.memories[0], SMARTAP, system=9)
        await scene.pass_s(5.0)
        (problem,) = scene.platform("autopilot-9").problems
        assert problem.text.startswith("unknown autopilot (smartap), neither PX4 nor ArduPilot: parameters, files")

    over(play)


def test_a_bare_vehicle_is_asked_a_few_times_for_what_it_does_not_tell() -> None:
    async def play(scene: Scene) -> None:
        requested: list[tuple[int, float, float]] = []

        def handle(data: bytes) -> None:
            for frame in Parser(is_datagram=True).receive(data):
                decoded = frame.decode()
                if decoded is not None and decoded.name == "COMMAND_LONG":
                    requested.append((decoded.command, decoded.param1, decoded.param2))

        scene.memories[0].b.on_data = handle
        Autopilot(scene.memories[0], PX4)
        await scene.pass_s(60.0)
        state = {(511, number, 1e6) for number in (1.0, 24.0, 30.0, 33.0, 74.0, 245.0)}
        readings = {
            (511, float(shape(name).id), 1e6 / WANTED_HZ[name])
            for name in READINGS
            if name not in ("EKF_STATUS_REPORT", "GPS_RAW_INT")
        }
        assert len(requested) == 4 * (6 + 5)
        assert set(requested) == state | readings

    over(play)


def test_a_link_that_is_closed_takes_its_bare_vehicles_with_it_and_a_platform_loses_its_autopilot() -> None:
    async def play(scene: Scene) -> None:
        Autopilot(scene.memories[0], PX4)
        await scene.pass_s(1.5)
        Autopilot(scene.memories[1], ARDUPILOT, system=2)
        tunnel = scene.companion(0)
        await scene.pass_s(6.0)
        assert list(scene.station.fleet.platforms) == ["heron", "ardupilot-2"]
        lost = scene.links[:]
        scene.links.clear()
        await scene.pass_s(1.0)
        assert list(scene.station.fleet.platforms) == ["heron"]
        assert scene.platform("heron").autopilot is None
        scene.links.append(lost[1])
        await scene.pass_s(5.0)
        assert list(scene.station.fleet.platforms) == ["heron", "ardupilot-2"]
        scene.links.append(lost[0])
        tunnel.close()

    over(play)
