"""MAVLink parameters: checks, stores and applies settings from the ground, reports local changes, packs ArduPilot's file."""

from struct import Struct
from typing import Final

from gloc3.mavlink.message import Address
from gloc3.mavlink.services.files.ftp import DATA_BYTES
from gloc3.mavlink.services.parameter import Parameter, ParameterEncoding, ParameterType, parameter
from gloc3.mavlink.services.parameter_server import ParameterServer
from gloc3_sitl.autopilot.parameters import ParameterKind, ParameterStore

_TYPES: Final = {
    ParameterKind.INT8: ParameterType.INT8,
    ParameterKind.INT16: ParameterType.INT16,
    ParameterKind.INT32: ParameterType.INT32,
    ParameterKind.REAL32: ParameterType.REAL32,
}


class ParameterSync:
    """Keeps the parameter server and the autopilot's store in step.

    Args:
        store: the autopilot's parameters.
        own: as whom the server speaks.
        is_bytewise: whether integers travel as PX4 has them, and not as ArduPilot does.
    """

    def __init__(self, store: ParameterStore, own: Address, *, is_bytewise: bool) -> None:
        self._store = store
        self._is_setting = False
        self.server: Final = ParameterServer(
            own,
            [parameter(row.name, store[row.name], _TYPES[row.kind]) for row in store.rows.values()],
            encoding=ParameterEncoding.BYTEWISE if is_bytewise else ParameterEncoding.CAST,
            check=self._check,
        )
        store.on_change.append(self._changed)

    def tick(self) -> None:
        """Discards the server's change reports: changes are applied when they are checked."""
        self.server.events()

    def _check(self, wanted: Parameter) -> None:
        """Applies a value from the ground.

        Raises:
            Refused: it is out of its bounds; the old value stays.
        """
        self._is_setting = True
        try:
            self._store.set(wanted.name, wanted.value)
        finally:
            self._is_setting = False

    def _changed(self, name: str, value: float) -> None:
        if not self._is_setting:  # what the ground sets the server keeps and tells by itself
            self.server.set(name, value)


PACKED_FILE: Final = "@PARAM/param.pck"
"""ArduPilot's file of all parameters over MAVLink FTP."""
PACKED_BYTES_EACH: Final = 24
"""Bytes for each parameter in the size that is reported for the file: as ArduPilot's, an estimate above its length."""
_MAGIC: Final = 0x671B
_HEADER: Final = Struct("<HHH")
_PACKED: Final = {
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
        number, form = _PACKED[row.kind]
        shared = next((at for at, (a, b) in enumerate(zip(last, name, strict=False)) if a != b), len(last))
        rest = name[shared:].encode()
        value = parameters[name]
        data = form.pack(value if row.kind is ParameterKind.REAL32 else int(value))
        over = (len(packed) + 2 + len(rest) + len(data)) % DATA_BYTES
        packed += bytes(len(data) - over if 0 < over < len(data) else 0)
        packed += bytes((number, shared | len(rest) - 1 << 4)) + rest + data
        last = name
    return bytes(packed)
