"""A bare autopilot's place and motion, in the form in which platforms tell them."""

from math import radians

import pytest

from gloc3.mavlink.codec import message
from gloc3.messages.frames import GeoPoint, LocalFrame
from gloc3_groundstation.station.autopilot_watch import PlaceWatch

HOME = GeoPoint(47.3977, 8.5456, 488.0)


def placed(
    watch: PlaceWatch, x: float, y: float, height: float, now_s: float, home: GeoPoint = HOME, **fields: int
) -> None:
    place = LocalFrame(home).to_geo((x, y, height))
    watch.receive(
        message(
            "GLOBAL_POSITION_INT",
            time_boot_ms=round(1000 * now_s),
            lat=round(place[0] * 1e7),
            lon=round(place[1] * 1e7),
            alt=round(place[2] * 1e3),
            relative_alt=round(height * 1e3),
            hdg=9000,
            **fields,
        ),
        now_s,
    )


def test_the_frame_begins_at_the_first_place_on_the_height_of_home() -> None:
    watch = PlaceWatch()
    assert watch.position_m() is None
    placed(watch, 0.0, 0.0, 3.0, 1.0)
    assert watch.site is not None
    assert watch.site.origin_geo == pytest.approx((HOME.latitude_deg, HOME.longitude_deg, 488.0), abs=1e-3)
    placed(watch, 20.0, -10.0, 12.0, 2.0, vx=300, vy=100, vz=-50)
    assert watch.position_m() == pytest.approx((20.0, -10.0, 12.0), abs=0.03)
    assert watch.motion is not None
    assert watch.motion.velocity_cm_s == (300, -100, 50)
    assert watch.motion.attitude_cdeg == (0, 0, 9000)


def test_heights_count_from_where_home_is_now_and_the_frame_stays_where_it_began() -> None:
    watch = PlaceWatch()
    placed(watch, 0.0, 0.0, 30.0, 1.0)
    placed(watch, 20.0, -10.0, 10.0, 2.0, HOME._replace(altitude_m=508.0))
    assert watch.position_m() == pytest.approx((20.0, -10.0, 10.0), abs=0.03)
    assert watch.site is not None
    assert watch.site.origin_geo == pytest.approx((HOME.latitude_deg, HOME.longitude_deg, 508.0), abs=1e-3)
    site = watch.site
    placed(watch, 20.0, -10.0, 10.0, 3.0, HOME._replace(altitude_m=508.1))
    assert watch.site is site, "noise moves nothing"


def test_attitude_and_battery_go_with_the_place_while_they_are_fresh() -> None:
    watch = PlaceWatch()
    attitude = message("ATTITUDE", roll=radians(5.0), pitch=radians(-2.0), yaw=radians(-90.0))
    watch.receive(attitude, 1.0)
    watch.receive(message("SYS_STATUS", voltage_battery=15_840, current_battery=1450), 1.0)
    placed(watch, 0.0, 0.0, 0.0, 1.5)
    assert watch.motion is not None
    assert watch.motion.attitude_cdeg == (500, -200, 27000)
    assert (watch.motion.battery_cv, watch.motion.battery_ca) == (1584, 1450)
    watch.receive(message("SYS_STATUS", voltage_battery=65_535, current_battery=-1), 2.0)
    placed(watch, 0.0, 0.0, 0.0, 9.0)
    assert watch.motion.attitude_cdeg == (0, 0, 9000)
    assert (watch.motion.battery_cv, watch.motion.battery_ca) == (0, 0)


def test_no_place_on_earth_and_angles_beyond_reason_are_not_believed() -> None:
    watch = PlaceWatch()
    watch.receive(message("GLOBAL_POSITION_INT", lat=0, lon=0, relative_alt=5000), 1.0)
    assert (watch.site, watch.motion) == (None, None)
    watch.receive(message("ATTITUDE", roll=float("nan")), 1.0)
    placed(watch, 0.0, 0.0, 0.0, 1.5)
    assert watch.motion is not None
