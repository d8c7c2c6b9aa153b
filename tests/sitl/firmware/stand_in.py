"""A program that stands in for a firmware: plays the peer of its name on a real socket, and is stopped like the real one.

    stand_in.py ardupilot --sim-port-out PORT …      stand_in.py px4 -i INSTANCE …

That of PX4 flies, by the embedded autopilot. It does not hear SIGTERM, as ArduPilot does not while it waits for physics.
"""

import json
import os
import shlex
import signal
import socket
import sys
from contextlib import suppress
from pathlib import Path


def main(words: list[str]) -> None:
    kind, *arguments = words
    reported = {name: value for name, value in os.environ.items() if name.startswith("PX4_")}
    Path("told.json").write_text(json.dumps({"arguments": arguments, "environment": reported}))
    signal.signal(signal.SIGTERM, signal.SIG_IGN if kind == "px4" else signal.SIG_DFL)
    if kind == "ardupilot":
        given = dict(zip(arguments[::2], arguments[1::2], strict=True))
        ardupilot(int(given["--sim-port-out"]), int(given["--serial0"].rpartition(":")[2]))
    elif kind == "px4":
        px4(int(arguments[arguments.index("-i") + 1]), px4_parameters())
    else:
        sys.exit("stand-in: Failed to find location")


def px4_parameters() -> dict[str, float]:
    """Runs `px4-rc.params`, the first on PATH, as PX4's start script does, and prints what PX4 prints.

    Before, as in that script, the failsafe's time is multiplied by the speed; and PX4 comes set up for a pilot.
    """
    file = next(
        file for folder in os.environ["PATH"].split(os.pathsep) if (file := Path(folder, "px4-rc.params")).is_file()
    )
    values = {"COM_OBL_RC_ACT": 0.0, "COM_OF_LOSS_T": float(os.environ.get("PX4_SIM_SPEED_FACTOR", "1"))}
    for line in file.read_text().splitlines():
        command, *words = shlex.split(line)
        if command == "echo":
            print(*words)
        elif words[1] == "NOT_THERE":
            print(f"ERROR [param] Parameter {words[1]} not found.")
        else:
            values[words[1]] = float(words[2])
    sys.stdout.flush()
    return values


def ardupilot(port: int, line_port: int) -> None:
    """Sends a heartbeat each second, and what it hears back to where it came from."""
    from tests.sitl.firmware.json_peer import JsonPeer

    from gloc3.mavlink.codec import Encoder, message

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


def px4(instance: int, parameters: dict[str, float]) -> None:
    """Flies, and sends to a companion, on the ports that PX4's own start script has for this instance."""
    from tests.sitl.firmware.embedded_px4 import EmbeddedPx4
    from tests.sitl.firmware.px4_peer import Px4Peer

    there = ("127.0.0.1", 14540 + instance)
    with (
        socket.create_connection(("127.0.0.1", 4560 + instance)) as link,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line,
    ):
        line.bind(("127.0.0.1", 14580 + instance))
        line.setblocking(False)
        autopilot = EmbeddedPx4(lambda data: send(line, data, there))
        store = autopilot.autopilot.parameters
        for name in parameters.keys() & store.rows.keys():
            store.set(name, parameters[name])
        peer = Px4Peer(control=autopilot)
        link.sendall(peer.send_hello())
        while data := link.recv(4096):
            with suppress(BlockingIOError, ConnectionRefusedError):
                while True:
                    autopilot.receive(line.recv(2048))
            link.sendall(peer.take(data))


def send(line: socket.socket, data: bytes, there: tuple[str, int]) -> None:
    """Sends a datagram, whether anybody listens or not."""
    with suppress(ConnectionRefusedError, BlockingIOError):
        line.sendto(data, there)


if __name__ == "__main__":
    main(sys.argv[1:])
