"""Reads a key of a Zenoh network that is not ours."""

import queue
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

import msgspec

from gloc3.errors import Gloc3Error

if TYPE_CHECKING:
    import zenoh

WAITING: Final = 64
"""Messages that wait to be read; the oldest are dropped."""


@contextmanager
def payloads(endpoint: str, key: str, wait_s: float) -> Iterator[Iterator[bytes | None]]:
    """Joins the network as a client; gives what is put on a key, and None after a while without any.

    Args:
        endpoint: of a node of that network, as `tcp/127.0.0.1:7447`.
        key: a key expression.
        wait_s: that while.

    Raises:
        Gloc3Error: the node is not reached, or the key is none.
    """
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("scouting/multicast/enabled", "false")
    came: queue.Queue[bytes] = queue.Queue(WAITING)

    def keep(sample: "zenoh.Sample") -> None:
        if came.full():
            came.get_nowait()
        came.put_nowait(sample.payload.to_bytes())

    def read() -> Iterator[bytes | None]:
        while True:
            try:
                yield came.get(timeout=wait_s)
            except queue.Empty:
                yield None

    try:
        config.insert_json5("connect/endpoints", msgspec.json.encode([endpoint]).decode())
        session = zenoh.open(config)
    except zenoh.ZError as error:
        raise Gloc3Error(f"{endpoint} is not reached: {error}") from error
    with session:
        try:
            subscriber = session.declare_subscriber(key, keep)
        except zenoh.ZError as error:
            raise Gloc3Error(f"{key!r} is no key: {error}") from error
        with subscriber:
            yield read()
