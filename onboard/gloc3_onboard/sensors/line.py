"""A line to a device: serial, or TCP to a converter or the device itself."""

import socket
from pathlib import Path
from typing import Protocol

from gloc3.errors import Gloc3Error
from gloc3_onboard.sensors.source_url import SERIAL_GROUP, SourceUrl, device_problem


class Line(Protocol):
    """A byte stream in both directions; a read waits briefly and may return nothing."""

    def read(self) -> bytes:
        """What has come in."""

    def write(self, data: bytes) -> None:
        """Sends."""

    def close(self) -> None:
        """Ends."""


class _Serial:
    def __init__(self, path: str, baud: int, wait_s: float) -> None:
        import serial

        self._port = serial.Serial(path, baud, timeout=wait_s, write_timeout=wait_s)

    def read(self) -> bytes:
        return bytes(self._port.read(max(1, self._port.in_waiting)))

    def write(self, data: bytes) -> None:
        self._port.write(data)

    def close(self) -> None:
        self._port.close()


class _Tcp:
    def __init__(self, address: tuple[str, int], wait_s: float) -> None:
        self._socket = socket.create_connection(address, 2.0)
        self._socket.settimeout(wait_s)

    def read(self) -> bytes:
        try:
            data = self._socket.recv(65_536)
        except TimeoutError:
            return b""
        if not data:
            raise OSError("the device has closed the connection")
        return data

    def write(self, data: bytes) -> None:
        self._socket.sendall(data)

    def close(self) -> None:
        self._socket.close()


def open_line(name: str, url: SourceUrl, address: tuple[str, int] | None, baud: int, wait_s: float) -> Line:
    """Opens the line named by a URL.

    Args:
        name: name of the device, for messages.
        url: its URL; the option `baud` overrides `baud`.
        address: host and port; None for a serial line.
        baud: rate of a serial line.
        wait_s: time-out of a read.

    Raises:
        Gloc3Error: it cannot be opened; the message says what to do.
    """
    try:
        if address is not None:
            return _Tcp(address, wait_s)
        problem = device_problem(Path(url.place), SERIAL_GROUP)
        if problem:
            raise Gloc3Error(f"{name}: {problem}")
        return _Serial(url.place, int(url.number("baud", baud)), wait_s)
    except OSError as error:
        raise Gloc3Error(f"{name}: {url.place}: {error.strerror or error}") from error
