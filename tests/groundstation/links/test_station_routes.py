"""Several ways to one platform: the best one carries a request, all of them what may have been lost, and nothing comes twice."""

import pytest
from msgspec.structs import replace

from gloc3.exchange.tunnel.events import Undelivered
from gloc3.messages.command_interface import AnyBody, CiRequest, Emergency, EmergencyVerb, Hello, Query, Steer, Verb
from gloc3.messages.envelope import Envelope, Source
from gloc3_groundstation.links.station_routes import LINE, NETWORK, OWN_NETWORK, StationRoute, StationRoutes


class Three:
    """A radio, Wi-Fi with MAVLink, and a network, opened in that order."""

    def __init__(self) -> None:
        self.routes = StationRoutes()
        self.ages: dict[str, float | None] = {"radio": 0.1, "wifi": 0.2, "network": 0.3}
        self.radio = self.routes.open(StationRoute(LINE, lambda _: self.ages["radio"]))
        self.wifi = self.routes.open(StationRoute(NETWORK, lambda _: self.ages["wifi"]))
        self.network = self.routes.open(StationRoute(OWN_NETWORK, lambda _: self.ages["network"]))
        self.sequence = 0

    def envelope(self, body: AnyBody, number: int = 0) -> Envelope[CiRequest]:
        self.sequence += 1
        request = CiRequest(sender="255", boot=7, sequence=number, body=body)
        return Envelope("heron/ci/request", Source("station_255", "client", 7), self.sequence, 0.0, "", "", request)

    def by(self, envelope: Envelope[CiRequest]) -> list[str]:
        names = {"radio": self.radio, "wifi": self.wifi, "network": self.network}
        return [name for name, number in names.items() if self.routes.carries(number, envelope)]


@pytest.fixture
def three() -> Three:
    return Three()


def test_the_best_way_that_leads_there_now_carries_a_request(three: Three) -> None:
    assert three.by(three.envelope(Hello(), 0)) == ["network"]
    three.ages["network"] = 4.0
    assert three.by(three.envelope(Hello(), 1)) == ["wifi"]
    three.ages["wifi"] = None
    assert three.by(three.envelope(Hello(), 2)) == ["radio"]


def test_while_none_leads_there_all_carry_it_and_wait(three: Three) -> None:
    three.ages = dict.fromkeys(three.ages, 30.0)
    assert three.by(three.envelope(Hello())) == ["radio", "wifi", "network"]


def test_all_carry_emergencies_and_what_may_have_been_lost(three: Three) -> None:
    everywhere = ["radio", "wifi", "network"]
    assert three.by(three.envelope(Emergency(verb=EmergencyVerb.HOLD), 0)) == everywhere
    assert three.by(three.envelope(Query(boot=7, sequence=0), 1)) == everywhere
    assert three.by(three.envelope(Steer(verb=Verb.PAUSE), 2)) == ["network"]
    assert three.by(three.envelope(Steer(verb=Verb.PAUSE), 2)) == everywhere, "it is sent again"


def test_the_choice_for_one_message_stays_as_it_was(three: Three) -> None:
    envelope = three.envelope(Hello())
    assert three.by(envelope) == ["network"]
    three.ages["network"] = None
    assert three.by(envelope) == ["network"]


def test_a_message_that_has_come_by_one_way_is_not_taken_from_another(three: Three) -> None:
    event = three.envelope(Hello())
    assert three.routes.is_new(three.wifi, event)
    assert not three.routes.is_new(three.radio, event)
    assert three.routes.is_new(three.wifi, event), "a long one comes in several messages"
    assert three.routes.is_new(three.radio, three.envelope(Hello()))


def test_only_when_every_way_that_carried_it_has_given_up_a_message_it_is_certain(three: Three) -> None:
    three.ages = dict.fromkeys(three.ages, 30.0)
    envelope = three.envelope(Hello())
    three.by(envelope)
    lost = Undelivered(envelope, None, True, "nobody to take it was heard")
    assert not three.routes.is_lost(three.radio, lost)
    assert not three.routes.is_lost(three.radio, lost)
    assert not three.routes.is_lost(three.wifi, replace(lost, envelope=replace(envelope, sequence=99)))
    assert not three.routes.is_lost(three.wifi, lost)
    assert three.routes.is_lost(three.network, lost)
    assert three.routes.is_lost(three.radio, replace(lost, is_certain=False)), "it may have arrived"


def test_the_word_of_the_one_way_that_carried_it_is_enough(three: Three) -> None:
    envelope = three.envelope(Hello())
    assert three.by(envelope) == ["network"]
    assert three.routes.is_lost(three.network, Undelivered(envelope, None, True, "nobody was heard"))


def test_a_way_that_was_closed_has_no_say_any_more(three: Three) -> None:
    three.ages = dict.fromkeys(three.ages, 30.0)
    envelope = three.envelope(Hello())
    three.by(envelope)
    three.routes.close(three.radio)
    lost = Undelivered(envelope, None, True, "nobody was heard")
    assert not three.routes.is_lost(three.wifi, lost)
    assert three.routes.is_lost(three.network, lost)
