from gloc3_sitl.firmware.real_time_pacer import MOST_BEHIND_S, RealTimePacer


def test_it_waits_where_it_is_early_and_not_where_it_is_late() -> None:
    pace = RealTimePacer(2.0)
    assert pace.wait_s(100.0, 0.0) == 0.0
    assert pace.wait_s(100.25, 1.0) == 0.25
    assert pace.wait_s(101.0, 1.0) == -0.5


def test_what_is_lost_is_caught_up_with() -> None:
    pace = RealTimePacer(1.0)
    pace.wait_s(0.0, 0.0)
    assert pace.wait_s(1.5, 0.1) < -1.0
    assert pace.wait_s(1.6, 1.7) > 0.0
    assert pace.slips == 0


def test_what_is_far_behind_slips() -> None:
    pace = RealTimePacer(1.0)
    pace.wait_s(0.0, 0.0)
    assert pace.wait_s(MOST_BEHIND_S + 1.0, 0.5) == 0.0
    assert pace.slips == 1
    assert pace.wait_s(MOST_BEHIND_S + 1.0, 1.5) == 1.0


def test_a_time_that_begins_anew_begins_now() -> None:
    pace = RealTimePacer(1.0)
    pace.wait_s(0.0, 5.0)
    assert pace.wait_s(10.0, 0.1) == 0.0
    assert pace.slips == 0
