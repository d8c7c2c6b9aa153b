"""Traffic from ADS-B and Remote ID: read, kept within bounds, compared with the vehicles, and shown."""

import struct
from math import cos, radians, sin
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.groundstation.scripted_platform import VEHICLE
from tests.groundstation.tui.views.test_views import PLATFORM, texts, view
from tests.groundstation.vehicles_scene import PX4, Autopilot, Scene, over

from gloc3.mavlink.codec import Encoder, Parser, message
from gloc3.mavlink.message import MavlinkMessage
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3_groundstation.mapping.ground import Ground
from gloc3_groundstation.mapping.projection import Projection
from gloc3_groundstation.station import alerts
from gloc3_groundstation.station.snapshots import Encounter, PlatformSnapshot, Timed, TrafficContact
from gloc3_groundstation.traffic.encounters import KEEPS_S, MOST_ENCOUNTERS, encounters_of
from gloc3_groundstation.traffic.reports import TrafficReport, read_reports
from gloc3_groundstation.traffic.traffic import KEPT_S, MOST_CONTACTS, MOST_FRAMES, Traffic
from gloc3_groundstation.tui.views.mission.map import Chart, map_lines
from gloc3_groundstation.tui.views.overview import detail_lines

HERE = GeoPoint(47.3977, 8.5456, 500.0)
PLANE = TangentPlane(HERE)
ADDRESS = bytes(range(1, 21))


def place(north_m: float, east_m: float) -> tuple[float, float]:
    latitude, longitude, _ = PLANE.geo_from_ned((north_m, east_m, 0.0))
    return latitude, longitude


def aircraft(north_m: float = 1500.0, east_m: float = 0.0, **fields: Any) -> dict[str, Any]:
    """An ADSB_VEHICLE that flies south at 60 m/s, 30 m above."""
    latitude, longitude = place(north_m, east_m)
    known = {
        "ICAO_address": 0x4B1234,
        "lat": round(1e7 * latitude),
        "lon": round(1e7 * longitude),
        "altitude": 530_000,
        "heading": 18_000,
        "hor_velocity": 6_000,
        "callsign": "SWR123",
        "flags": 31,
    }
    return known | fields


def received(name: str, **fields: Any) -> MavlinkMessage:
    [frame] = Parser().receive(Encoder(9, 1).encode(message(name, **fields)))
    decoded = frame.decode()
    assert decoded is not None
    return decoded


def reports(name: str, **fields: Any) -> list[TrafficReport]:
    return list(read_reports(received(name, **fields)))


# --- messages ---


def test_an_aircraft_is_read_with_what_its_flags_hold() -> None:
    [full] = reports("ADSB_VEHICLE", **aircraft(tslc=3, ver_velocity=-250, flags=31 + 128))
    assert (full.key, full.name, full.altitude_m, full.age_s) == (
        "adsb 4B1234",
        "SWR123",
        530.0,
        3.0,
    )
    assert full.velocity_ne_m_s == pytest.approx((-60.0, 0.0), abs=1e-9)
    assert full.place == pytest.approx(place(1500.0, 0.0), abs=1e-6)
    [bare] = reports("ADSB_VEHICLE", **aircraft(flags=0))
    assert bare == TrafficReport("adsb 4B1234")
    [bad] = reports("ADSB_VEHICLE", **aircraft(lat=910_000_000, callsign="\x1b[2J\x07A"))
    assert (bad.place, bad.name) == (None, "[2JA")


def test_remote_id_is_read_alone_and_in_packs() -> None:
    [name] = reports("OPEN_DRONE_ID_BASIC_ID", id_or_mac=ADDRESS, uas_id=b"1581F5YHQ".ljust(20, b"\0"))
    assert (name.key, name.name) == (f"rid {ADDRESS.hex()}", "1581F5YHQ")
    [where] = reports(
        "OPEN_DRONE_ID_LOCATION",
        id_or_mac=ADDRESS,
        latitude=473977000,
        longitude=85456000,
        altitude_geodetic=545.5,
        direction=9000,
        speed_horizontal=1200,
        speed_vertical=-150,
    )
    assert (where.place, where.altitude_m) == ((47.3977, 8.5456), 545.5)
    assert where.velocity_ne_m_s == pytest.approx((0.0, 12.0), abs=1e-9)
    basic = struct.pack("<BB20s3x", 0x02, 0x12, b"1581F5YHQ")
    location = struct.pack(
        "<BBBBbiiHHHBBHBB",
        0x12,
        0x22,
        90,
        40,
        -3,
        473977000,
        85456000,
        0,
        round((545.5 + 1000.0) * 2),
        0,
        0,
        0,
        0,
        0,
        0,
    )
    assert (len(basic), len(location)) == (25, 25)
    packed = reports(
        "OPEN_DRONE_ID_MESSAGE_PACK",
        id_or_mac=ADDRESS,
        single_message_size=25,
        msg_pack_size=2,
        messages=(basic + location).ljust(225, b"\0"),
    )
    assert packed[0] == name
    assert packed[1].velocity_ne_m_s == pytest.approx((0.0, -10.0), abs=1e-9)
    assert packed[1][2:4] == where[2:4]


def test_the_vehicle_s_own_remote_id_is_no_traffic() -> None:
    assert reports("OPEN_DRONE_ID_LOCATION", latitude=473977000, longitude=85456000) == []


def test_what_is_not_known_is_not_made_up() -> None:
    unknown = {"direction": 36100, "speed_horizontal": 25500, "speed_vertical": 6300, "altitude_geodetic": -1000.0}
    assert reports("OPEN_DRONE_ID_LOCATION", id_or_mac=ADDRESS, **unknown) == [TrafficReport(f"rid {ADDRESS.hex()}")]


@given(st.binary(min_size=225, max_size=225), st.integers(0, 255))
def test_any_pack_is_borne(data: bytes, count: int) -> None:
    fields = {"id_or_mac": ADDRESS, "single_message_size": 25, "msg_pack_size": count, "messages": data}
    for report in reports("OPEN_DRONE_ID_MESSAGE_PACK", **fields):
        assert report.name.isprintable()


# --- encounters ---


def vehicle(*, is_armed: bool = True) -> PlatformSnapshot:
    state = replace(VEHICLE, geo=tuple(HERE), is_armed=is_armed)
    return replace(PLATFORM, vehicle=Timed(state, 100.0))


def contact(
    north_m: float, east_m: float = 0.0, track_deg: float = 180.0, speed_m_s: float = 60.0, **fields: Any
) -> TrafficContact:
    track = radians(track_deg)
    known: dict[str, Any] = {
        "key": "adsb 4B1234",
        "name": "SWR123",
        "place": place(north_m, east_m),
        "altitude_m": 530.0,
        "velocity_ne_m_s": (speed_m_s * cos(track), speed_m_s * sin(track)),
        "received_s": 100.0,
    }
    return TrafficContact(**(known | fields))


@pytest.mark.parametrize(
    ("met", "severity", "text"),
    [
        (contact(400.0), Severity.ERROR, "SWR123: 400 m away, 30 m above, closing"),
        (contact(400.0, track_deg=0.0), Severity.ERROR, "SWR123: 400 m away, 30 m above"),
        (contact(400.0, altitude_m=700.0), Severity.WARNING, "SWR123: 400 m away, 200 m above, closing"),
        (contact(400.0, altitude_m=900.0), None, "SWR123: 400 m away, 400 m above, closing"),
        (contact(1800.0), Severity.WARNING, "SWR123: 1.8 km away, 30 m above, closing"),
        (contact(1800.0, 700.0), None, "SWR123: 1.9 km away, 30 m above"),
        (contact(1800.0, track_deg=0.0), None, "SWR123: 1.8 km away, 30 m above"),
        (contact(2600.0), None, "SWR123: 2.6 km away, 30 m above, closing"),
        (contact(1000.0, altitude_m=None, name=""), Severity.WARNING, "4B1234: 1.0 km away, height not told, closing"),
        (contact(60.0, altitude_m=497.0, velocity_ne_m_s=None), Severity.ERROR, "SWR123: 60 m away, same height"),
        (contact(1000.0, received_s=95.0), Severity.WARNING, "SWR123: 700 m away, 30 m above, closing"),
    ],
)
def test_the_limits_of_alerts(met: TrafficContact, severity: Severity | None, text: str) -> None:
    [found] = encounters_of(vehicle(), [met], 100.0)
    assert (str(found), found.severity) == (text, severity)


def test_an_alert_does_not_come_and_go_at_the_border_of_its_distance() -> None:
    before: tuple[Encounter, ...] = ()

    def met(north_m: float, now_s: float, *, is_armed: bool = True) -> Severity | None:
        nonlocal before
        heard = vehicle(is_armed=is_armed)
        assert heard.vehicle is not None
        heard = replace(heard, received_s=now_s, vehicle=replace(heard.vehicle, received_s=now_s))
        hovers = contact(north_m, speed_m_s=0.0, received_s=now_s)
        before = encounters_of(heard, [hovers], now_s, before)
        return before[0].severity

    seen = [met(500.0 + 40.0 * sin(0.3 * step), 100.0 + 0.1 * step) for step in range(400)]
    first = seen.index(Severity.ERROR)
    assert (set(seen[:first]), set(seen[first:])) == ({None}, {Severity.ERROR})
    ended = [met(700.0, 140.0 + 0.1 * step) for step in range(200)]
    assert ended.index(None) * 0.1 == pytest.approx(KEEPS_S, abs=0.2), "it is over once it has stayed away"
    assert set(ended[ended.index(None) :]) == {None}
    assert met(400.0, 161.0) is Severity.ERROR
    assert met(400.0, 162.0, is_armed=False) is None


def test_a_vehicle_on_the_ground_has_no_alerts_and_far_traffic_is_not_listed() -> None:
    [found] = encounters_of(vehicle(is_armed=False), [contact(400.0)], 100.0)
    assert found.severity is None
    assert encounters_of(vehicle(), [contact(6000.0)], 100.0) == ()
    assert encounters_of(replace(PLATFORM, vehicle=None), [contact(400.0)], 100.0) == ()
    many = [contact(4000.0 - 10.0 * number, key=f"adsb {number:06X}", track_deg=0.0) for number in range(300)]
    listed = encounters_of(vehicle(), [*many, contact(1900.0)], 100.0)
    assert len(listed) == MOST_ENCOUNTERS
    assert listed[0].severity is Severity.WARNING
    assert listed[1].distance_m == pytest.approx(1010.0, abs=10.0)


# --- the station ---


def flown(scene: Scene) -> tuple[Autopilot, Traffic]:
    autopilot = Autopilot(scene.memories[0], PX4, base_mode=128)
    return autopilot, Traffic(scene.station, lambda: scene.links)


async def at(scene: Scene, autopilot: Autopilot, seconds: float = 5.0) -> None:
    for _ in range(round(seconds)):
        autopilot.report("GLOBAL_POSITION_INT", lat=473977000, lon=85456000, alt=500_000, relative_alt=12_000)
        await scene.pass_s(1.0)


def test_an_aircraft_that_comes_is_an_alert_and_an_event_and_is_forgotten() -> None:
    async def play(scene: Scene) -> None:
        autopilot, traffic = flown(scene)
        await at(scene, autopilot)
        receiver = Autopilot(scene.memories[1], PX4, system=7)  # heard on another link
        receiver.is_on = False
        receiver.report("ADSB_VEHICLE", **aircraft(4000.0))
        await at(scene, autopilot, 2.0)
        fleet = scene.station.fleet
        assert [str(one) for one in fleet.encounters] == ["SWR123: 3.9 km away, 30 m above"]
        receiver.report("ADSB_VEHICLE", **aircraft(1500.0))
        await at(scene, autopilot, 2.0)
        receiver.report("ADSB_VEHICLE", **aircraft(400.0))
        await at(scene, autopilot, 2.0)
        told = [text for text in scene.texts() if text.startswith("traffic")]
        assert len(told) == 2, "once, and again when it has become worse"
        assert told[0].endswith("above, closing")
        fleet, now_s = scene.station.fleet, scene.station.now_s()
        [alert] = [one for one in alerts.causes(fleet, now_s) if one.what.startswith("traffic")]
        assert (alert.platform, alert.severity) == ("px4-1", Severity.ERROR)
        await at(scene, autopilot, KEPT_S + 2.0)
        assert scene.station.fleet.traffic == ()
        assert scene.station.fleet.encounters == ()
        traffic.close()

    over(play)


def test_thousands_of_invented_aircraft_displace_none_that_is_near() -> None:
    async def play(scene: Scene) -> None:
        autopilot, traffic = flown(scene)
        await at(scene, autopilot)
        autopilot.report("ADSB_VEHICLE", **aircraft(900.0))
        await at(scene, autopilot, 1.0)
        for second in range(3):
            for number in range(1500):
                far = aircraft(20_000.0 + number, ICAO_address=1 + number + 5000 * second, callsign="X")
                autopilot.report("ADSB_VEHICLE", **far)
            await at(scene, autopilot, 2.0)
            assert len(scene.station.fleet.traffic) <= MOST_CONTACTS
        assert "SWR123" in {one.name for one in scene.station.fleet.traffic}
        assert traffic.dropped >= 3 * (1500 - MOST_FRAMES)
        near = aircraft(300.0, ICAO_address=0xABCDEF, callsign="NEAR")
        autopilot.report("ADSB_VEHICLE", **near)
        await at(scene, autopilot, 2.0)
        assert "NEAR" in {one.name for one in scene.station.fleet.traffic}
        traffic.close()

    over(play)


# --- screens ---


def test_the_overview_and_the_map_show_what_is_near() -> None:
    shown = view(vehicle())
    found = encounters_of(vehicle(), [contact(400.0), contact(900.0, 300.0, key="rid 1", name="DRONE")], 100.0)
    fleet = replace(
        shown.fleet, traffic=(contact(400.0), contact(900.0, 300.0, key="rid 1", name="DRONE")), encounters=found
    )
    shown = shown._replace(fleet=fleet)
    lines = texts(detail_lines(shown))
    blank = " " * 11
    first = next(number for number, line in enumerate(lines) if line.startswith(" traffic"))
    assert lines[first : first + 4] == [
        " traffic   SWR123: 400 m away, 30 m",
        f"{blank}above, closing",
        f"{blank}DRONE: 950 m away, 30 m",
        f"{blank}above, closing",
    ]
    drawn = "\n".join(
        texts(map_lines(Chart(shown, Ground(shown.platform), Projection(0.0, 0.0, 10.0, 0.0, 160, 160)), 80, 40))
    )
    assert "◆" in drawn
    assert "SWR123 +30 m 400 m" in drawn


def test_an_encounter_says_how_far_it_is() -> None:
    one = Encounter(platform="x", key="k", name="N", distance_m=42.0, above_m=-20.0, is_closing=True)
    assert str(one) == "N: 40 m away, 20 m below, closing"
