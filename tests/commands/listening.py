"""The sockets that a running program listens on, as the kernel lists them under /proc."""

import os
import re
from collections.abc import Iterator
from ipaddress import ip_address
from pathlib import Path
from typing import NamedTuple

PROC = Path("/proc")
TCP_LISTEN = "0A"
UDP_UNCONNECTED = "07"
"""A UDP socket that has no single peer receives from anyone."""


class ListeningSocket(NamedTuple):
    """A socket on which a program receives what strangers send."""

    kind: str
    """`tcp` or `udp`."""
    host: str
    port: int

    @property
    def is_open(self) -> bool:
        """Whether other computers reach it."""
        return not ip_address(self.host).is_loopback

    def __str__(self) -> str:
        return f"{self.kind} {self.host}:{self.port}"


def listening(group: int) -> list[ListeningSocket]:
    """The TCP and UDP sockets of all processes of a process group, each once."""
    found = set[ListeningSocket]()
    for process in _processes(group):
        inodes = {match[1] for link in _links(process) if (match := re.fullmatch(r"socket:\[(\d+)\]", link))}
        for kind, state in (("tcp", TCP_LISTEN), ("udp", UDP_UNCONNECTED)):
            for table in (kind, f"{kind}6"):
                found.update(_rows(process / "net" / table, kind, state, inodes))
    return sorted(found)


def _processes(group: int) -> Iterator[Path]:
    for folder in PROC.iterdir():
        try:
            if folder.name.isdigit() and os.getpgid(int(folder.name)) == group:
                yield folder
        except ProcessLookupError:
            continue


def _links(process: Path) -> Iterator[str]:
    try:
        for one in (process / "fd").iterdir():
            yield str(one.readlink())
    except OSError:  # it has ended
        return


def _rows(table: Path, kind: str, state: str, inodes: set[str]) -> Iterator[ListeningSocket]:
    try:
        lines = table.read_text().splitlines()[1:]
    except OSError:
        return
    for line in lines:
        _, local, _, its_state, *_, inode = line.split()[:10]
        if inode in inodes and its_state == state:
            host, port = local.split(":")
            yield ListeningSocket(kind, _address(host), int(port, 16))


def _address(text: str) -> str:
    """An address of the table: words of 32 bits in the byte order of the machine, in hexadecimal digits."""
    words = [bytes.fromhex(text[at : at + 8])[::-1] for at in range(0, len(text), 8)]
    return str(ip_address(b"".join(words)))


ALONE = ("unshare", "-rn", "sh", "-c", 'ip link set lo up && exec "$@"', "sh")
"""Runs a program in a network of its own, where all ports are free and nobody else listens or sends."""
