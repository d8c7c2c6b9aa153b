"""The path requested: what components were asked to fly, and until when."""

from gloc3.evaluation.requested_path import RequestedPath
from gloc3.exchange.base import LocalExchange, Publisher
from gloc3.messages.envelope import FunctionRequest


def test_a_way_that_nobody_has_ended_ends_when_another_one_begins() -> None:
    exchange = LocalExchange()
    path = RequestedPath(exchange, "p")
    for t_s, name, altitude_m in ((1.0, "one", None), (4.0, "two", 20.0)):
        order = {"waypoints_ned_m": [[1.0, 2.0, -3.0]], "speed_m_s": 0.5, "altitude_m": altitude_m}
        requested = {"action_id": name, "arguments": order}
        request = FunctionRequest(request_id=name, function="action.start", arguments=requested)
        Publisher(exchange, "p", "command_server", 1).publish("p/components/waypoints/function", request, t_s)
    assert [(flight.action_id, flight.start_s, flight.end_s) for flight in path.flights] == [
        ("one", 1.0, 4.0),
        ("two", 4.0, None),
    ]
    assert [flight.is_height_kept for flight in path.flights] == [False, True]
