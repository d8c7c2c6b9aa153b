"""How well the requested path is kept, in calm air and in gusts; and flights that are to turn each figure red."""

from tests.flight.accuracy import CALM_LIMITS, SPEED_M_S, WIND_RMS_M, cut_corners, fly, hover, skip_a_leg
from tests.flight.card import Card

from gloc3_sitl.physics.wind import gusty


def test_in_calm_air_the_path_is_kept_within_decimetres_at_the_speed_that_was_asked(flight: Card) -> None:
    result = fly(flight)
    assert result.rms_m <= CALM_LIMITS[0]
    assert result.max_m <= CALM_LIMITS[1]
    assert result.is_complete
    assert result.slowest_m_s >= 0.9 * SPEED_M_S


def test_in_gusts_of_a_wind_of_6_m_s_the_path_is_kept_too(flight: Card) -> None:
    result = fly(flight, wind=gusty(6.0, from_deg=270.0))
    assert result.rms_m <= WIND_RMS_M
    assert result.is_complete
    assert result.slowest_m_s >= 0.9 * SPEED_M_S


def test_a_flight_that_hovers_passes_nothing_and_has_no_speed(flight: Card) -> None:
    result = hover(flight)
    assert result.passed == 0
    assert result.slowest_m_s < 0.9 * SPEED_M_S


def test_a_flight_that_skips_a_leg_has_great_errors(flight: Card) -> None:
    result = skip_a_leg(flight)
    assert result.rms_m > WIND_RMS_M
    assert result.max_m > CALM_LIMITS[1]
    assert not result.is_complete


def test_a_flight_that_cuts_corners_misses_waypoints(flight: Card) -> None:
    result = cut_corners(flight)
    assert result.max_m > CALM_LIMITS[1]
    assert not result.is_complete
