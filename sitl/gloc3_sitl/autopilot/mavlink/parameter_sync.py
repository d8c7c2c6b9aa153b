"""MAVLink parameters: checks, stores and applies settings from the ground, and reports local changes."""

from typing import Final

from gloc3.mavlink.message import Address
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
