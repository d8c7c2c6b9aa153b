"""Two stations with one id are told; a station that was started anew is not."""

from gloc3_onboard.command_server.authority import DOUBLED_AGAIN_S as AGAIN_S
from gloc3_onboard.command_server.authority import MOST_STATIONS as MOST
from gloc3_onboard.command_server.authority import Senders


def test_requests_of_two_lives_in_turn_are_two_stations_told_once_a_minute() -> None:
    senders = Senders()
    reported = [senders.receive("255", 1 + n % 2, float(n)) for n in range(20)]
    assert [text for text in reported if text] == [
        "two stations have the id 255, and their commands are mixed: change one of them (--station-id)"
    ]
    assert senders.receive("255", 1, AGAIN_S + 10.0)


def test_a_station_that_is_started_anew_and_its_last_words_before_are_one_station() -> None:
    senders = Senders()
    reported = [senders.receive("255", boot, 0.0) for boot in (1, 1, 1, 2, 1, 2, 2, 2, 3, 3, 3)]
    assert not any(reported)


def test_other_stations_are_kept_apart_and_no_more_is_remembered_than_needed() -> None:
    senders = Senders()
    for n in range(10_000):
        assert not senders.receive(str(n), 1, 0.0)
        assert not senders.receive("one", n, 0.0)
    assert len(senders._lives) <= MOST
    assert len(senders._lives["one"]) <= MOST
