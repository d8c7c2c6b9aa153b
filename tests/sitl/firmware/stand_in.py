"""A program that stands in for a firmware: plays the peer of its name on a real socket, and is stopped like the real one.

    stand_in.py ardupilot --sim-port-out PORT …      stand_in.py px4 -i INSTANCE …

That of PX4 does not hear SIGTERM, as ArduPilot does not while it waits for physics.
"""

import json
import os
import signal
import socket
import sys
from contextlib import suppress
from pathlib import Path


def main(words: list[str]) -> None:
    kind, *arguments = words
    told = {name: value for name, value in os.environ.items() if name.startswith("PX4_")}
    Path("told.json").write_text(json.dumps({"arguments": arguments, "environment": told}))
    signal.signal(signal.SIGTERM, signal.SIG_IGN if kind == "px4" else signal.SIG_DFL)
    if kind == "ardupilot":
        given = dict(zip(arguments[::2], arguments[1::2], strict=True))
        ardupilot(int(given["--sim-port-out"]), int(given["--serial0"].rpartition(":")[2]))
    elif kind == "px4":
        px4(4560 + int(arguments[arguments.index("-i") + 1]))
    else:
        sys.exit("stand-in: Failed to find location")


def ardupilot(port: int, line_port: int) -> None:
    """Sends a heartbeat each second, and what it hears back to where it came from."""
    from tests.sitl.firmware.json_peer import JsonPeer

    from gloc3.link.codec import Encoder, message

    peer, encoder, beats = JsonPeer(), Encoder(1, 1), 0
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line,
    ):
        link.settimeout(0.1)
        line.setblocking(False)
        while True:
            if peer.frame >= beats * 800:
                beats += 1
                line.sendto(encoder.encode(message("HEARTBEAT", autopilot=3)), ("127.0.0.1", line_port))
            with suppress(BlockingIOError):
                line.sendto(line.recv(2048), ("127.0.0.1", line_port))
            link.sendto(peer.servos(), ("127.0.0.1", port))
            try:
                peer.take(link.recv(2048))
            except TimeoutError:
                continue


def px4(port: int) -> None:
    from tests.sitl.firmware.px4_peer import Px4Peer

    peer = Px4Peer()
    with socket.create_connection(("127.0.0.1", port)) as link:
        link.sendall(peer.greet())
        while data := link.recv(4096):
            link.sendall(peer.take(data))


if __name__ == "__main__":
    main(sys.argv[1:])
