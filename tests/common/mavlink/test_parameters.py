"""Parameters: both encodings, lossy links, and what is refused."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gloc3.errors import Refused
from gloc3.mavlink.codec import message
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.parameter import Parameter, ParameterEncoding, ParameterType, parameter, read_parameter
from gloc3.mavlink.services.parameter_client import (
    MOST_VEHICLES,
    ParameterCall,
    ParameterClient,
    ParameterFetch,
    ParameterResult,
)
from gloc3.mavlink.services.parameter_server import (
    ParameterChanged,
    ParameterError,
    ParameterRefused,
    ParameterServer,
    ParameterWanted,
)
from gloc3.mavlink.transport.memory import Conditions

from .pair import STATION, VEHICLE, Pair

PARAMETERS = [
    parameter("SPEED", 0.1),
    parameter("GAIN", -2.5),
    parameter("MODE", 3, ParameterType.INT32),
    parameter("MASK", -8_388_607, ParameterType.INT32),
    parameter("SMALL", 200, ParameterType.UINT8),
    *(parameter(f"P{number:03d}", number, ParameterType.INT32) for number in range(195)),
]


def within_limit(wanted: Parameter) -> None:
    if wanted.name == "SPEED" and wanted.value > 10.0:
        raise Refused("too fast")


def wired(
    loss: float = 0.0, encoding: ParameterEncoding = ParameterEncoding.BYTEWISE, seed: int = 1
) -> tuple[Pair, ParameterServer, ParameterClient]:
    pair = Pair(seed, Conditions(latency_s=0.02, loss=loss))
    server = ParameterServer(VEHICLE, PARAMETERS, encoding=encoding, check=within_limit)
    client = ParameterClient(STATION, encoding)
    pair.add([server], [client])
    return pair, server, client


def finish(pair: Pair, call: ParameterCall | ParameterFetch) -> ParameterResult | None:
    pair.run(60.0, lambda: call.result is not None)
    return call.result


@pytest.mark.parametrize("encoding", ParameterEncoding)
@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_list_is_fetched_whole_over_a_lossy_link(loss: float, encoding: ParameterEncoding) -> None:
    for seed in range(3):
        pair, _, client = wired(loss, encoding, seed)
        fetch = client.fetch(VEHICLE, now_s=0.0)
        assert finish(pair, fetch) is ParameterResult.DONE
        assert fetch.parameters == {each.name: each for each in PARAMETERS}
        assert fetch.progress == 1.0
        assert pair.now_s < 15.0
        with pytest.raises(Refused, match="type of NONE is not known"):
            client.set(VEHICLE, "NONE", 1, now_s=pair.now_s)


@pytest.mark.parametrize("encoding", ParameterEncoding)
def test_a_parameter_is_set_and_read_back(encoding: ParameterEncoding) -> None:
    pair, server, client = wired(0.2, encoding)
    assert finish(pair, client.set(VEHICLE, "MODE", -7, ParameterType.INT32, now_s=0.0)) is ParameterResult.DONE
    assert server["MODE"] == -7
    assert (
        finish(pair, client.set(VEHICLE, "SPEED", 0.3, ParameterType.REAL32, now_s=pair.now_s)) is ParameterResult.DONE
    )
    (mode, speed) = (event for event in server.events() if isinstance(event, ParameterChanged))
    assert (mode.parameter.value, mode.before.value, mode.sender) == (-7, 3, STATION)
    assert speed.parameter.value == pytest.approx(0.3)
    call = client.read(VEHICLE, "SMALL", now_s=pair.now_s)
    assert finish(pair, call) is ParameterResult.DONE
    assert call.value == parameter("SMALL", 200, ParameterType.UINT8)
    assert finish(pair, client.set(VEHICLE, "SMALL", 7, now_s=pair.now_s)) is ParameterResult.DONE


def test_what_the_vehicle_does_not_allow_is_told() -> None:
    pair, server, client = wired()
    call = client.set(VEHICLE, "SPEED", 11.0, ParameterType.REAL32, now_s=0.0)
    assert finish(pair, call) is ParameterResult.REFUSED
    assert call.value == parameter("SPEED", 0.1)
    call = client.set(VEHICLE, "GAIN", math.nan, ParameterType.REAL32, now_s=pair.now_s)
    assert finish(pair, call) is ParameterResult.REFUSED
    call = client.set(VEHICLE, "MODE", 1.0, ParameterType.REAL32, now_s=pair.now_s)
    assert finish(pair, call) is ParameterResult.REFUSED
    assert finish(pair, client.read(VEHICLE, "NONE", now_s=pair.now_s)) is ParameterResult.NO_SUCH
    call = client.set(VEHICLE, "NONE", 1.0, ParameterType.REAL32, now_s=pair.now_s)
    assert finish(pair, call) is ParameterResult.NO_SUCH
    assert server.events() == []


def test_nobody_there_is_told() -> None:
    pair, _, client = wired(loss=1.0)
    call = client.read(VEHICLE, "MODE", now_s=0.0)
    with pytest.raises(Refused, match="MODE is being read or set"):
        client.read(VEHICLE, "MODE", now_s=0.0)
    fetch = client.fetch(VEHICLE, now_s=0.0)
    with pytest.raises(Refused, match="being fetched"):
        client.fetch(VEHICLE, now_s=0.0)
    assert finish(pair, call) is ParameterResult.NO_ANSWER
    assert finish(pair, fetch) is ParameterResult.NO_ANSWER
    assert pair.now_s < 10.0


def test_a_change_by_somebody_else_is_told_to_all() -> None:
    pair, server, client = wired()
    finish(pair, client.fetch(VEHICLE, now_s=0.0))
    client.events()
    server.set("GAIN", 4.0)
    pair.run(1.0)
    assert client.events() == [parameter("GAIN", 4.0)]
    with pytest.raises(Refused, match="no parameter NONE"):
        server.set("NONE", 1.0)


def test_a_list_does_not_flood_the_link() -> None:
    _, server, _ = wired()
    server.receive(message("PARAM_REQUEST_LIST", target_system=1), STATION, 0.0)
    sent = 0
    for step in range(500):
        server.tick(step * 0.001)
        sent += len(server.outgoing())
    assert 90 <= sent <= 110


@pytest.mark.parametrize(
    ("name", "value", "kind"),
    [
        ("", 1.0, ParameterType.REAL32),
        ("A" * 17, 1.0, ParameterType.REAL32),
        ("A", 1.5, ParameterType.INT32),
        ("A", 256, ParameterType.UINT8),
        ("A", 1e300, ParameterType.REAL32),
        ("A", math.nan, ParameterType.INT32),
        ("A", math.inf, ParameterType.INT32),
    ],
)
def test_values_that_do_not_fit_are_refused(name: str, value: float, kind: ParameterType) -> None:
    with pytest.raises(Refused):
        parameter(name, value, kind)


@given(st.integers(-(2**31), 2**31 - 1))
def test_every_integer_survives_bytewise(value: int) -> None:
    wanted = parameter("A", value, ParameterType.INT32)
    bits = wanted.to_bits(ParameterEncoding.BYTEWISE)
    raw = message("PARAM_VALUE", param_value=bits, param_type=6)
    read = raw.shape.decode(raw.shape.encode(raw), 0, raw.shape.size)
    assert read_parameter("A", read.param_value, read.param_type, ParameterEncoding.BYTEWISE) == wanted


@given(st.integers(0, 2**32 - 1), st.integers(0, 255), st.sampled_from(ParameterEncoding))
def test_anything_at_all_may_come(bits: int, kind: int, encoding: ParameterEncoding) -> None:
    read = read_parameter("A", bits, kind, encoding)
    assert read is None or read.is_same(read)
    client, server = ParameterClient(STATION, encoding), ParameterServer(Address(1, 1), PARAMETERS)
    client.receive(message("PARAM_VALUE", param_id="MODE", param_value=bits, param_type=kind), VEHICLE, 0.0)
    server.receive(
        message("PARAM_SET", param_id="MODE", param_value=bits, param_type=kind, target_system=1), STATION, 0.0
    )


def test_a_fetch_and_a_call_may_be_cancelled_and_begun_again() -> None:
    pair, _, client = wired()
    fetch, call = client.fetch(VEHICLE, now_s=0.0), client.read(VEHICLE, "GAIN", now_s=0.0)
    for work in (fetch, call):
        client.cancel(work)
        assert work.result is ParameterResult.CANCELLED
        client.cancel(work)
    assert client.next_tick_s() is None
    assert finish(pair, client.fetch(VEHICLE, now_s=pair.now_s)) is ParameterResult.DONE


def test_what_a_slow_radio_has_left_out_is_fetched_without_waiting_in_between() -> None:
    radio = Conditions(latency_s=0.15, bandwidth_bit_s=57_600, bits_per_byte=10)
    pair = Pair(1, radio)
    many = [parameter(f"P{number}", number, ParameterType.INT32) for number in range(1000)]
    client = ParameterClient(STATION)
    pair.add([ParameterServer(VEHICLE, many)], [client])
    fetch = client.fetch(VEHICLE, now_s=0.0)
    assert finish(pair, fetch) is ParameterResult.DONE
    assert pair.link.a.dropped > 50
    assert pair.now_s < 15.0


@pytest.mark.parametrize(
    ("name", "value", "kept"),
    [
        ("MODE", 7.0, 7),
        ("MODE", -7.0, -7),
        ("MODE", 6.9999, 7),
        ("MODE", 2.7, 2),
        ("SMALL", 255.0, 255),
        ("SMALL", 256.0, None),
        ("SMALL", -1.0, None),
        ("MODE", 2.0**31, None),
        ("MODE", math.inf, None),
        ("MODE", math.nan, None),
    ],
)
@pytest.mark.parametrize("kind", [ParameterType.REAL32, ParameterType.INT16, ParameterType.UINT8])
def test_where_values_are_cast_any_type_is_taken_for_the_parameters_own_if_the_value_fits(
    name: str, value: float, kept: int | None, kind: ParameterType
) -> None:
    server = ParameterServer(VEHICLE, PARAMETERS, encoding=ParameterEncoding.CAST)
    before = server[name]
    bits = Parameter(name, value).to_bits(ParameterEncoding.CAST)
    requested = message("PARAM_SET", param_id=name, param_value=bits, param_type=kind, target_system=1)
    server.receive(requested, STATION, 0.0)
    answers = server.outgoing()
    assert (
        [answer.name for answer in answers] == ["PARAM_VALUE"] if kept is not None else ["PARAM_ERROR", "PARAM_VALUE"]
    )
    assert server[name] == (before if kept is None else kept)
    assert [change.parameter.value for change in server.events()] == ([] if kept is None else [kept])
    reported = answers[-1]
    assert (
        read_parameter(name, reported.param_value, reported.param_type, ParameterEncoding.CAST)
        == server.parameters[[each.name for each in server.parameters].index(name)]
    )


def test_a_station_that_sends_floats_sets_an_integer_where_values_are_cast() -> None:
    pair, server, client = wired(encoding=ParameterEncoding.CAST)
    call = client.set(VEHICLE, "MODE", 5.0, ParameterType.REAL32, now_s=0.0)
    assert finish(pair, call) is ParameterResult.DONE
    assert server["MODE"] == 5


def leaving() -> tuple[Pair, ParameterServer, ParameterClient]:
    """A server whose owner decides on GAIN, and lets only the station set SPEED."""

    def leave(wanted: ParameterWanted) -> bool:
        if wanted.parameter.name == "SPEED" and wanted.sender != STATION:
            raise ParameterRefused("not yours", ParameterError.PERMISSION_DENIED)
        return wanted.parameter.name == "GAIN"

    pair = Pair(1)
    server = ParameterServer(VEHICLE, PARAMETERS, encoding=ParameterEncoding.CAST, leave=leave)
    client = ParameterClient(STATION, ParameterEncoding.CAST)
    pair.add([server], [client])
    return pair, server, client


def wanted_of(server: ParameterServer) -> ParameterWanted:
    (wanted,) = (event for event in server.events() if isinstance(event, ParameterWanted))
    return wanted


@pytest.mark.parametrize(
    ("error", "expected", "value"),
    [(None, ParameterResult.DONE, 2.0), (ParameterError.READ_ONLY, ParameterResult.REFUSED, 0.5)],
)
def test_a_value_that_is_left_to_the_owner_waits_for_him(
    error: ParameterError | None, expected: ParameterResult, value: float
) -> None:
    pair, server, client = leaving()
    server.set("GAIN", 0.5)
    call = client.set(VEHICLE, "GAIN", 2.0, ParameterType.REAL32, now_s=0.0)
    pair.run(0.4)
    assert (server["GAIN"], call.result) == (0.5, None)
    wanted = [wanted_of(server)]

    def decide(_now_s: float) -> None:
        wanted.extend(event for event in server.events() if isinstance(event, ParameterWanted))
        for one in wanted:
            server.conclude(one, error)

    pair.vehicle.after = decide
    assert finish(pair, call) is expected
    assert server["GAIN"] == value


def test_while_the_owner_decides_another_value_is_refused_and_a_repeat_waits_with_the_first() -> None:
    _, server, _ = leaving()
    bits = parameter("GAIN", 2.0).to_bits(ParameterEncoding.CAST)
    fields = {"target_system": 1, "target_component": 1, "param_id": "GAIN", "param_type": 9}
    for _ in range(3):
        server.receive(message("PARAM_SET", param_value=bits, **fields), STATION, 0.0)
    assert server.outgoing() == []
    server.receive(message("PARAM_SET", param_value=bits, **fields), Address(254, 190), 0.1)
    assert [(reported.name, getattr(reported, "error", 0)) for reported in server.outgoing()] == [
        ("PARAM_ERROR", 3),
        ("PARAM_VALUE", 0),
    ]
    server.conclude(wanted_of(server), None)
    assert server["GAIN"] == 2.0


def test_who_may_not_set_a_value_is_told_so() -> None:
    _, server, _ = leaving()
    fields = {"target_system": 1, "target_component": 1, "param_id": "SPEED", "param_type": 9}
    server.receive(message("PARAM_SET", param_value=0, **fields), Address(254, 190), 0.0)
    assert [getattr(reported, "error", 0) for reported in server.outgoing()] == [ParameterError.PERMISSION_DENIED, 0]


def test_thousands_who_ask_for_the_list_do_not_keep_it_from_coming_to_its_end() -> None:
    _, server, _ = leaving()
    requested = message("PARAM_REQUEST_LIST", target_system=1, target_component=1)
    reported: list[int] = []
    for step in range(400):
        server.receive(requested, Address(step % 250 + 1, 190), step * 0.01)
        server.tick(step * 0.01)
        reported += [one.param_index for one in server.outgoing()]
    assert set(reported) == set(range(len(PARAMETERS)))
    assert len(reported) <= 400 * 4


def test_parameters_of_senders_that_somebody_invents_take_bounded_room_and_the_vehicle_keeps_its_own() -> None:
    client = ParameterClient(STATION)
    client.fetch(VEHICLE, now_s=0.0)
    value = message("PARAM_VALUE", param_id="A", param_value=0, param_type=6, param_count=9, param_index=0)
    client.receive(value, VEHICLE, 0.0)
    for number in range(1000):
        client.receive(value, Address(2 + number % 250, number // 250), 0.0)
    assert len(client.known) == MOST_VEHICLES
    assert "A" in client.known[VEHICLE]
