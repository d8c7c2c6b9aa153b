"""What pilots look for on the overview: what the autopilot says of satellites, estimator, radio and battery, with its age."""

from math import nan
from typing import Any

import pytest
from tests.groundstation.vehicles_scene import ARDUPILOT, PX4, Autopilot, Scene, over

from gloc3.mavlink.codec import Encoder, message, shape
from gloc3.mavlink.message import Address
from gloc3_groundstation.station.alerts import Alerts
from gloc3_groundstation.station.readings import MESSAGES, SIK, WANTED_HZ, FlightClock, ReadingsWatch, radio
from gloc3_groundstation.station.wording import duration
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.overview import detail_lines
from gloc3_groundstation.tui.widgets.lines import Tone

FRAME = 12
"""Bytes of a MAVLink 2 frame around its payload."""
CELLS = (4200, 4200, 4100, *(65535,) * 7)


def details(scene: Scene, name: str, now_s: float | None = None) -> dict[str, tuple[str, Tone]]:
    """The details on the overview, by their names."""
    at_s = scene.station.now_s() if now_s is None else now_s
    view = StationView(
        fleet=scene.station.fleet,
        platform=scene.platform(name),
        alerts=Alerts(),
        now_s=at_s,
        started_s=0.0,
        station="255",
    )
    return {line[0].text.strip(): (line[1].text, line[1].tone) for line in detail_lines(view, 70)}


@pytest.mark.parametrize("has_companion", [False, True])
def test_readings_are_shown_with_and_without_a_companion_absent_as_absent_and_stale_with_their_age(
    has_companion: bool,
) -> None:
    async def play(scene: Scene) -> None:
        autopilot = Autopilot(scene.memories[0], ARDUPILOT)
        tunnel = scene.companion(0) if has_companion else None
        await scene.pass_s(5.0)
        name = "heron" if has_companion else "ardupilot-1"
        before = details(scene, name)
        for reading in ("gps", "flight", "charge", "estimator", "vibration", "rc", "radio"):
            assert before[reading] == ("–", Tone.DIM), reading
        autopilot.report("GPS_RAW_INT", fix_type=4, satellites_visible=17, eph=80)
        variances = {"velocity_variance": 0.03, "pos_horiz_variance": 0.6, "pos_vert_variance": 0.1}
        autopilot.report("EKF_STATUS_REPORT", compass_variance=0.2, **variances)
        autopilot.report("VIBRATION", vibration_x=12.0, vibration_y=14.0, vibration_z=61.0)
        autopilot.report("RC_CHANNELS", chancount=8, rssi=127)
        autopilot.report("BATTERY_STATUS", id_=0, voltages=CELLS, current_battery=1210, current_consumed=830)
        autopilot.report("BATTERY_STATUS", id_=1, voltages=CELLS, current_battery=1, current_consumed=1)
        autopilot.report("HOME_POSITION", latitude=473977000, longitude=85456000)
        autopilot.report("GLOBAL_POSITION_INT", lat=473986000, lon=85456000, hdg=0)
        scene.memories[0].b.send(Encoder(*SIK).encode(message("RADIO_STATUS", rssi=127, remrssi=131)))
        await scene.pass_s(1.5)
        found = details(scene, name)
        assert found["gps"] == ("DGPS 17 sat HDOP 0.8", Tone.TEXT)
        assert found["estimator"] == ("pos 0.60 mag 0.20 hgt 0.10 vel 0.03", Tone.WARN)
        assert found["vibration"] == ("12 14 61 m/s²", Tone.BAD)
        assert found["rc"] == ("RSSI 50 %", Tone.TEXT)
        assert found["radio"] == ("-60 dBm here, -58 dBm there", Tone.TEXT)
        assert found["charge"] == ("830 mAh used", Tone.TEXT)
        assert found["battery"][0].endswith(", 12.5 V 12.1 A")
        assert found["flight"] == ("–, home 100 m", Tone.TEXT)
        await scene.pass_s(12.0)
        stale = details(scene, name)
        assert stale["gps"] == ("DGPS 17 sat HDOP 0.8 (13 s ago)", Tone.STALE)
        if tunnel is not None:
            tunnel.close()

    over(play)


def test_a_flight_is_timed_from_take_off_to_landing() -> None:
    async def play(scene: Scene) -> None:
        autopilot = Autopilot(scene.memories[0], PX4)
        await scene.pass_s(1.5)
        autopilot.report("EXTENDED_SYS_STATE", landed_state=1)
        await scene.pass_s(5.0)
        autopilot.beat["base_mode"] = 128
        await scene.pass_s(5.0)
        assert details(scene, "px4-1")["flight"][0] == "–", "armed on the ground"
        autopilot.report("EXTENDED_SYS_STATE", landed_state=2)
        await scene.pass_s(66.0)
        assert details(scene, "px4-1")["flight"][0] == "1 min 05 s"
        autopilot.beat["base_mode"] = 0
        await scene.pass_s(3.0)
        assert details(scene, "px4-1")["flight"][0] == "1 min 05 s (last)"

    over(play)


def test_of_a_flight_that_was_found_under_way_the_time_is_a_lower_bound() -> None:
    clock = FlightClock()
    for now_s in (100.0, 130.0):
        clock.update(is_flying=True, now_s=now_s)
    assert clock.words(duration) == "over 30 s"


def reading(name: str, report: str, **fields: Any) -> str | None:
    """Of a PX4, after one message."""
    watch = ReadingsWatch()
    watch.receive(message(report, **fields), PX4, 0.0)
    found = watch.all.get(name)
    return None if found is None else found.text


def test_the_requested_readings_take_little_of_a_radio_link() -> None:
    assert set(WANTED_HZ) == set(MESSAGES)
    byte_s = sum(rate_hz * (FRAME + shape(name).size) for name, rate_hz in WANTED_HZ.items())
    assert byte_s <= 0.03 * 57_600 / 10


def test_what_a_message_does_not_know_is_left_out() -> None:
    assert reading("gps", "GPS_RAW_INT", fix_type=0, satellites_visible=255, eph=65535) == "no GPS"
    assert reading("gps", "GPS_RAW_INT", fix_type=6, satellites_visible=24, eph=50) == "RTK fixed 24 sat HDOP 0.5"
    assert reading("rc", "RC_CHANNELS", chancount=0, rssi=0) is None
    assert reading("rc", "RC_CHANNELS", chancount=4, rssi=255) == "received"
    assert reading("rc", "RC_CHANNELS", chancount=4, rssi=80) == "RSSI 80 %", "PX4 counts in percent"
    assert reading("power", "SYS_STATUS", voltage_battery=65535, current_battery=-1) is None
    assert reading("power", "SYS_STATUS", voltage_battery=15800, current_battery=-1) == "15.8 V"
    assert reading("charge", "BATTERY_STATUS", voltages=(65535,) * 10, current_battery=-1, current_consumed=-1) is None
    nothing = dict.fromkeys(("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio"), nan)
    assert reading("estimator", "ESTIMATOR_STATUS", **nothing) is None
    assert reading("estimator", "ESTIMATOR_STATUS", **{**nothing, "vel_ratio": 0.034}) == "vel 0.03"
    assert reading("vibration", "VIBRATION", vibration_z=0.84, clipping_0=2) == "accel 0.8 m/s², clipped 2"
    said = radio(message("RADIO_STATUS", rssi=180, remrssi=255), Address(1, 1))
    assert said == ("RSSI 180 here", 0)
