"""Client of the service manager that started this process: datagrams of `KEY=VALUE` lines (sd_notify(3))."""

import os
import socket
from collections.abc import Callable, MutableMapping
from typing import Final

NOTIFY_SOCKET: Final = "NOTIFY_SOCKET"
WATCHDOG_USEC: Final = "WATCHDOG_USEC"
WATCHDOG_PID: Final = "WATCHDOG_PID"


class ServiceManager:
    """Reports the service's state to the service manager, where there is one.

    Args:
        address: of its socket, `@` before an abstract one; empty where there is none.
        watchdog_s: how often it wants to hear that the service is alive; None where it does not watch.
        warn: told once, and again after it has worked, when it cannot be reached.
    """

    def __init__(self, address: str, watchdog_s: float | None, warn: Callable[[str], None]) -> None:
        self.watchdog_s: Final = watchdog_s
        self._warn = warn
        self._is_reached = True
        self._status = ""
        self._socket: socket.socket | None = None
        self._address = "\0" + address[1:] if address.startswith("@") else address
        if address:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)

    @classmethod
    def of_this_process(cls, environment: MutableMapping[str, str], warn: Callable[[str], None]) -> "ServiceManager":
        """The manager that the environment names; it is taken out of there, since it is not for children."""
        address = environment.pop(NOTIFY_SOCKET, "")
        microseconds, process = environment.pop(WATCHDOG_USEC, ""), environment.pop(WATCHDOG_PID, "")
        is_watched = microseconds.isdecimal() and int(microseconds) > 0 and process in ("", str(os.getpid()))
        return cls(address, int(microseconds) / 1e6 if is_watched else None, warn)

    @property
    def is_there(self) -> bool:
        """Whether there is a manager."""
        return self._socket is not None

    def ready(self) -> None:
        """Reports READY: the service is up, or up again after a reload."""
        self._notify("READY=1")

    def status(self, text: str) -> None:
        """Reports a status line for people, when it changes."""
        if text != self._status:
            self._status = text
            self._notify(f"STATUS={text}".replace("\n", " "))

    def alive(self) -> None:
        """Feeds the watchdog."""
        if self.watchdog_s is not None:
            self._notify("WATCHDOG=1")

    def reloading(self, monotonic_s: float) -> None:
        """Reports RELOADING, from now (CLOCK_MONOTONIC) until `ready`."""
        self._notify(f"RELOADING=1\nMONOTONIC_USEC={round(monotonic_s * 1e6)}")

    def stopping(self) -> None:
        """Reports STOPPING."""
        self._notify("STOPPING=1")

    def extend(self, for_s: float) -> None:
        """Extends the time allowed for start or stop, from now."""
        self._notify(f"EXTEND_TIMEOUT_USEC={round(for_s * 1e6)}")

    def close(self) -> None:
        """Tells nothing any more."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _notify(self, text: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(text.encode(), self._address)
        except OSError as error:
            if self._is_reached:
                self._warn(f"the service manager cannot be notified: {error.strerror or error}")
            self._is_reached = False
        else:
            self._is_reached = True
