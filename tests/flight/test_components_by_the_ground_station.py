"""The station's component desk in flight: a fault is read, the component brought up again, the mission resumed."""

from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission

from gloc3.messages.summaries import Health
from gloc3_groundstation.desk.component_desk import ComponentDesk
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.station.data_chain import stages
from gloc3_groundstation.station.snapshots import ComponentSnapshot

WAY = "{out: {follow_waypoints: {waypoints_m: [[8, 0, 1.5]], speed_m_s: 0.5}}}"


def seen(flight: Card, name: str) -> ComponentSnapshot:
    """A component as the station knows it."""
    platform = flight.flight.station.fleet.platforms[flight.flight.name]
    return next(each for each in platform.components(flight.now_s) if each.name == name)


@ONE_STYLE
def test_what_a_station_offers_is_what_the_vehicle_accepts_and_force_is_offered_where_it_helps(flight: Card) -> None:
    flight.begin(mission(WAY))
    flight.await_state("sweep.out", "running")
    desk: ComponentDesk = Desk(flight.flight.station).components
    name = flight.flight.name
    assert desk.wiring(name) is not None
    refusal = flight.run(desk.command(name, "waypoints", "stop"))
    assert refusal.can_be_forced
    for command, state in (("goquiet", "quiet"), ("resume", "working"), ("stop", "standby"), ("initialize", "standby")):
        flight.until(lambda: seen(flight, "height").health is not None, 3.0, "height is known")
        assert command in desk.commands(seen(flight, "height"))
        answer = flight.run(desk.command(name, "height", command))
        assert answer.is_accepted, answer.text
        assert answer.text == f"state {state}"
        flight.until(lambda state=state: seen(flight, "height").health is Health(state), 3.0, state)  # type: ignore[misc]
    flight.run(desk.command(name, "height", "start"))
    flight.until(lambda: seen(flight, "height").health is Health.WORKING, 3.0, "it works again")
    (entry, _) = desk.functions(name, seen(flight, "height"))
    answer = flight.run(desk.call(name, "height", entry, {"rate_hz": "10"}))
    assert answer.text == "rate_hz 10.0"
    flight.await_state("mission", "done", 60.0)
    components = flight.flight.station.fleet.platforms[name].components(flight.now_s)
    assert not [stage for stage in stages(components) if stage.stops]
