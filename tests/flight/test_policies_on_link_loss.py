"""DESIGN §6, on_link_loss: nothing from the holder of control for `link_loss_after_s`, and what then happens."""

from tests.flight.card import Card
from tests.flight.missions import mission


def fly_out_and_lose_the_link(flight: Card, policy: str, **policies: object) -> float:
    """The radio falls silent while the vehicle sweeps; returns when."""
    flight.begin(mission(on_link_loss=policy, **policies))
    flight.await_state("sweep", "running")
    flight.wait(1.0)
    flight.fault("link_loss")
    return flight.now_s


def test_a_lost_link_lands_the_vehicle_where_it_is(flight: Card) -> None:
    lost_s = fly_out_and_lose_the_link(flight, "land")
    flight.await_policy("land", 6.0)
    assert 4.0 < flight.now_s - lost_s < 6.0
    x, _, _ = flight.position_m
    flight.await_landed()
    assert abs(flight.position_m[0] - x) < 1.0
    assert flight.state("mission") == "failed"
