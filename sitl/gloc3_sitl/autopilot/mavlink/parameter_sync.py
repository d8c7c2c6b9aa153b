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
        own: the server's MAVLink address.
        is_bytewise: whether integers are encoded as by PX4 rather than as by ArduPilot.
    """

    def __init__(self, store: ParameterStore, own: Address, *, is_bytewise: bool) -> None:
        self._store = store
        self._is_setting = False
        self.server: Final = ParameterServer(
            own,
            [parameter(row.name, store[row.name], _TYPES[row.kind]) for row in store.rows.values()],
            encoding=ParameterEncoding.BYTEWISE if is_bytewise else ParameterEncoding.CAST,
            check=self._check,
            tells_unknown=not is_bytewise,  # PX4 says nothing
        )
        store.on_change.append(self._changed)

    def tick(self) -> None:
        """Discards the server's change reports: changes are applied when they are checked."""
        self.server.events()

    def _check(self, wanted: Parameter) -> None:
        """Applies a value from the ground.

        Raises:
            Refused: out of bounds; the old value stays.
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
_MAGIC_WITH_DEFAULTS: Final = 0x671C
_HAS_DEFAULT: Final = 1 << 4
"""The flag of a parameter behind whose value its default stands."""
_HEADER: Final = Struct("<HHH")
_PACKED: Final = {
    ParameterKind.INT8: (1, Struct("<b")),
    ParameterKind.INT16: (2, Struct("<h")),
    ParameterKind.INT32: (3, Struct("<i")),
    ParameterKind.REAL32: (4, Struct("<f")),
}
"""Number of the type in the file, and the form of its value."""


def queried_parameters(parameters: ParameterStore, query: str) -> bytes:
    """The file for `start=N&count=N&withdefaults=1`, of which each part may be missing; what else is asked for is ignored."""
    asked = {key: value for key, _, value in (part.partition("=") for part in query.split("&")) if value.isdecimal()}
    count = int(asked["count"]) if "count" in asked else None
    return packed_parameters(
        parameters, int(asked.get("start", "0")), count, has_defaults=int(asked.get("withdefaults", "0")) != 0
    )


def packed_parameters(
    parameters: ParameterStore, start: int = 0, count: int | None = None, *, has_defaults: bool = False
) -> bytes:
    """The content of `@PARAM/param.pck`: a header, then each parameter with what its name does not share with the last.

    Zeros before a parameter keep its value inside one block of an FTP reply.

    Args:
        parameters: all of them.
        start: the first that is packed.
        count: how many are packed; None for all that follow.
        has_defaults: whether a value that is not its default has that behind it.
    """
    rows = list(parameters.rows.values())[start:][:count]
    magic = _MAGIC_WITH_DEFAULTS if has_defaults else _MAGIC
    packed = bytearray(_HEADER.pack(magic, len(rows), len(parameters)))
    last = ""
    for row in rows:
        number, form = _PACKED[row.kind]
        name, value = row.name, parameters[row.name]
        shared = next((at for at, (a, b) in enumerate(zip(last, name, strict=False)) if a != b), len(last))
        rest = name[shared:].encode()
        values = (value, row.default) if has_defaults and value != row.default else (value,)
        data = b"".join(form.pack(one if row.kind is ParameterKind.REAL32 else int(one)) for one in values)
        over = (len(packed) + 2 + len(rest) + len(data)) % DATA_BYTES
        packed += bytes(len(data) - over if 0 < over < len(data) else 0)
        flags = _HAS_DEFAULT if len(values) > 1 else 0
        packed += bytes((number | flags, shared | len(rest) - 1 << 4)) + rest + data
        last = name
    return bytes(packed)
