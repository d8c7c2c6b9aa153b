"""Client of systemd's journal: entries with fields of their own, which `journalctl COMPONENT=pose` finds.

The form is that of systemd's native journal protocol: `KEY=VALUE` lines, and a length before a value with line breaks.
"""

import socket
import struct
from collections.abc import Mapping
from typing import Final

SOCKET: Final = "/run/systemd/journal/socket"
MOST_BYTES: Final = 60_000
"""Of a value; a datagram of more than the socket's buffer would need a file."""


def entry(fields: Mapping[str, str]) -> bytes:
    """An entry as the journal takes it; empty values are left out."""
    parts = []
    for name, text in fields.items():
        value = text.encode(errors="replace")[:MOST_BYTES]
        if b"\n" in value:
            parts.append(name.encode() + b"\n" + struct.pack("<Q", len(value)) + value + b"\n")
        elif value:
            parts.append(name.encode() + b"=" + value + b"\n")
    return b"".join(parts)


class SystemdJournal:
    """Sends entries to the journal of this computer, and never waits for it.

    Args:
        identifier: of all entries, as `journalctl -t` finds them.
        address: of its socket.
    """

    def __init__(self, identifier: str, address: str = SOCKET) -> None:
        self._identifier, self._address = identifier, address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self._socket.setblocking(False)

    def send(self, priority: int, message: str, fields: Mapping[str, str]) -> bool:
        """Sends an entry; returns whether the journal has it.

        Args:
            priority: as in syslog, 0 the worst.
            message: what a person reads.
            fields: further ones, with names in capitals.
        """
        named = {"MESSAGE": message, "PRIORITY": str(priority), "SYSLOG_IDENTIFIER": self._identifier, **fields}
        try:
            self._socket.sendto(entry(named), self._address)
        except OSError:  # there is none, or it is busy: the line goes to stderr
            return False
        return True

    def close(self) -> None:
        """Sends no more."""
        self._socket.close()
