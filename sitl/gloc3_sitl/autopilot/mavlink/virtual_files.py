"""ArduPilot's virtual files over MAVLink FTP: `@PARAM/param.pck` and `@SYS/uarts.txt`."""

from os.path import commonprefix
from struct import Struct
from typing import Final

from gloc3.mavlink.services.files.ftp import DATA_BYTES
from gloc3_sitl.autopilot.mavlink.links import AutopilotPort
from gloc3_sitl.autopilot.parameters import ParameterKind, ParameterStore

PARAMETERS: Final = "@PARAM/param.pck"
UARTS: Final = "@SYS/uarts.txt"
UARTS_BYTES: Final = 100_000
"""Size that ArduPilot reports for every file under `@SYS`, whatever its length."""
_BYTES_EACH: Final = 24
_MAGIC: Final = 0x671B
_HEADER: Final = Struct("<HHH")
_TYPES: Final = {
    ParameterKind.INT8: (1, Struct("<b")),
    ParameterKind.INT16: (2, Struct("<h")),
    ParameterKind.INT32: (3, Struct("<i")),
    ParameterKind.REAL32: (4, Struct("<f")),
}
"""Number of the type in the file, and the form of its value."""


def packed_parameters(parameters: ParameterStore) -> bytes:
    """The content of `@PARAM/param.pck`: a header, then each parameter with what its name does not share with the last.

    Zeros before a parameter keep its value inside one block of an FTP reply.
    """
    packed = bytearray(_HEADER.pack(_MAGIC, len(parameters), len(parameters)))
    last = ""
    for name, row in parameters.rows.items():
        number, form = _TYPES[row.kind]
        shared = min(len(commonprefix((last, name))), len(name) - 1)
        rest = name[shared:].encode()
        value = parameters[name]
        data = form.pack(value if row.kind is ParameterKind.REAL32 else int(value))
        over = (len(packed) + 2 + len(rest) + len(data)) % DATA_BYTES
        packed += bytes(len(data) - over if 0 < over < len(data) else 0)
        packed += bytes((number, shared | len(rest) - 1 << 4)) + rest + data
        last = name
    return bytes(packed)


def reported_bytes(parameters: ParameterStore) -> int:
    """Size that is reported for `@PARAM/param.pck`: as ArduPilot's, an estimate above its length."""
    return _BYTES_EACH * len(parameters)


def uarts(links: list[AutopilotPort]) -> bytes:
    """The content of `@SYS/uarts.txt`: a line for each link."""
    lines = [f"SERIAL{number} {link.kind} PEERS={len(link.peers)}" for number, link in enumerate(links)]
    return "\n".join(("UARTV1", *lines, "")).encode()
