"""The device `memory`: a few bytes of a component that outlive the process, as long as the computer is not restarted."""

import msgspec

from gloc3.errors import UNREADABLE
from gloc3.store import Records, RecordStore


class RecordMemory:
    """Keeps the last bytes as a record.

    Args:
        records: the file.
        computer: tells this start of the computer from every other; its clock begins anew with each.
    """

    def __init__(self, records: Records, computer: str) -> None:
        self._store = RecordStore(records, "memory of components")
        self._computer = computer

    def load(self) -> bytes | None:
        """What was kept last since the computer was started; None for nothing."""
        records = self._store.load()
        if not records:
            return None
        try:
            computer, data = msgspec.msgpack.decode(records[-1], type=tuple[str, bytes])
        except UNREADABLE:
            return None
        return data if computer == self._computer else None

    def keep(self, data: bytes) -> None:
        """Replaces what is kept."""
        self._store.rewrite([msgspec.msgpack.encode((self._computer, data))], outlives_power_cut=False)
