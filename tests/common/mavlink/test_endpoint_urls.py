"""Endpoint URLs: what they say, and what is said about wrong ones."""

import pytest

from gloc3.errors import Refused
from gloc3.mavlink.transport.endpoints import EndpointUrl, parse_url


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("udpin://0.0.0.0:14550", {"scheme": "udpin", "host": "0.0.0.0", "port": 14550}),
        ("udpin://:14550", {"scheme": "udpin", "host": "127.0.0.1", "port": 14550}),
        ("udpin://127.0.0.1:0", {"scheme": "udpin", "host": "127.0.0.1", "port": 0}),
        ("udpout://companion.local:14540", {"scheme": "udpout", "host": "companion.local", "port": 14540}),
        ("tcpin://[::1]:5760", {"scheme": "tcpin", "host": "::1", "port": 5760}),
        ("tcpout://10.0.0.2:5760", {"scheme": "tcpout", "host": "10.0.0.2", "port": 5760}),
        ("serial:///dev/ttyACM0:921600", {"scheme": "serial", "device": "/dev/ttyACM0", "baud": 921600}),
        ("serial:///dev/ttyACM0", {"scheme": "serial", "device": "/dev/ttyACM0", "baud": 57600}),
        ("serial:///dev/ttyUSB0:auto", {"scheme": "serial", "device": "/dev/ttyUSB0", "baud": None}),
        (
            "udpout://10.0.0.5:14550?rate=57600",
            {"scheme": "udpout", "host": "10.0.0.5", "port": 14550, "rate_bit_s": 57600},
        ),
        ("tcpin://:5760?key=a%20b.key", {"scheme": "tcpin", "host": "127.0.0.1", "port": 5760, "key": "a b.key"}),
        (
            "serial:///dev/ttyUSB0:57600?rate=30000&key=/etc/k",
            {"scheme": "serial", "device": "/dev/ttyUSB0", "rate_bit_s": 30000, "key": "/etc/k"},
        ),
        (
            "udpin://:14551?role=observer",
            {"scheme": "udpin", "host": "127.0.0.1", "port": 14551, "role": "observer"},
        ),
        ("serial_flowcontrol:///dev/x:1", {"scheme": "serial_flowcontrol", "device": "/dev/x", "baud": 1}),
    ],
)
def test_good_urls_are_read(url: str, expected: dict[str, object]) -> None:
    assert parse_url(url) == EndpointUrl(url=url, **expected)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("14550", "no scheme"),
        ("udpin://:14550?role=observr", "'observr' is no role; did you mean 'observer'?"),
        ("udp://:14550", "use udpin:// to listen or udpout:// to send"),
        ("udpinn://:14550", "did you mean 'udpin'"),
        ("udpin://0.0.0.0", "names no port"),
        ("udpin://0.0.0.0:99999", "Port out of range"),
        ("udpin://0.0.0.0:port", "Port could not be cast"),
        ("udpout://:14550", "no host"),
        ("tcpout://host:0", "port 0 is for listening only"),
        ("tcpin://0.0.0.0:5760/path", "may follow the port, nothing stand before the host"),
        ("udpout://host:1?rate=fast", "'fast' is no rate; give bits a second, 1200 or more"),
        ("udpout://host:1?rate=10", "'10' is no rate"),
        ("udpout://host:1?key=", "names no key file"),
        ("serial:///dev/ttyUSB0?baud=1", "no option 'baud'"),
        ("udpout://host:1?rte=1", "did you mean 'rate'"),
        ("serial://", "names no device"),
        ("serial:///dev/ttyACM0:fast", "'fast' is no baud rate; give a number, or auto"),
        ("serial:///dev/ttyACM0:0", "'0' is no baud rate"),
    ],
)
def test_bad_urls_are_refused_with_the_reason(url: str, reason: str) -> None:
    with pytest.raises(Refused, match=reason):
        parse_url(url)


@pytest.mark.parametrize(
    ("url", "line_bit_s"),
    [
        ("udpout://10.0.0.5:14550", None),
        ("udpout://10.0.0.5:14550?rate=9600", 9600),
        ("serial:///dev/ttyUSB0:57600", 57600),
        ("serial:///dev/ttyUSB0:57600?rate=20000", 20000),
        ("serial:///dev/ttyUSB0:auto", None),
    ],
)
def test_what_leaves_by_a_link_stays_below_what_its_radio_carries(url: str, line_bit_s: int | None) -> None:
    assert parse_url(url).line_bit_s == line_bit_s
    assert parse_url(url).address == url.partition("?")[0]


@pytest.mark.parametrize(
    ("url", "is_signed", "is_told"),
    [
        ("udpin://0.0.0.0:14550", False, True),
        ("tcpin://192.168.1.10:5760", False, True),
        ("udpin://0.0.0.0:14550", True, False),
        ("udpin://0.0.0.0:14550?key=a.key", False, False),
        ("udpin://:14550", False, False),
        ("tcpin://localhost:5760", False, False),
        ("udpout://192.168.1.10:14550", False, False),
        ("serial:///dev/ttyUSB0", False, False),
    ],
)
def test_a_link_that_a_network_reaches_without_a_key_is_told(url: str, is_signed: bool, is_told: bool) -> None:
    assert ("open to the network and not signed" in parse_url(url).warning(is_signed=is_signed)) is is_told
