"""Parameters of a vehicle: listed with progress, compared with a file, set and read back.

This uses our own parameter client, not MAVSDK's, which reports neither progress nor types (so no bounds) and cannot be
cancelled; its `get_all_params` never returns when the vehicle goes silent in the middle (measured with 4.1: more than
50 s, and the process does not end after it).
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from gloc3.errors import Gloc3Error, Refused
from gloc3.exchange.base import Unsubscribe
from gloc3.mavlink.services.parameter import Parameter
from gloc3.mavlink.services.parameter_client import ParameterCall, ParameterClient, ParameterResult
from gloc3_groundstation.services.descriptions.component_metadata import MetadataService, NotOffered
from gloc3_groundstation.services.descriptions.parameter_info import Infos, load_infos, read_infos
from gloc3_groundstation.services.descriptions.shipped import layered, shipped_infos
from gloc3_groundstation.services.files import FileService
from gloc3_groundstation.services.machines import Machines
from gloc3_groundstation.services.parameter_files import (
    ParameterFormat,
    load_parameter_file,
    spell,
    write_parameter_file,
)
from gloc3_groundstation.services.parameter_table import ParameterChange, ParameterDiff, ParameterRow, ParameterTable
from gloc3_groundstation.services.progress import OnProgress, Quietly
from gloc3_groundstation.services.snapshot import SnapshotService

INFO_PATHS: Final = ("/etc/extras/parameters.json.xz",)
"""Path of a PX4 vehicle's description of its own parameters."""
MOST_SILENT: Final = 2
"""Unanswered parameters after which the rest are not tried."""


class WriteReport(msgspec.Struct, frozen=True, kw_only=True):
    """Results of several changes."""

    written: tuple[ParameterChange, ...] = ()
    """Set, and read back as they were set."""
    refused: Mapping[str, str] = {}
    """Name to reason."""
    needs_restart: tuple[str, ...] = ()
    """Those that hold only after the vehicle was restarted, as far as that is known."""


class ParameterService:
    """Reads and sets parameters. `table` holds what is known now; it is replaced at each change."""

    def __init__(
        self,
        machines: Machines,
        client: ParameterClient,
        snapshot: SnapshotService,
        files: FileService,
        metadata: MetadataService,
    ) -> None:
        self.table = ParameterTable()
        self._machines = machines
        self._client = client
        self._snapshot = snapshot
        self._files = files
        self._metadata = metadata
        self._own_infos: Infos = {}
        self._listeners: list[Callable[[ParameterTable], None]] = []
        machines.on_event(self._on_event)

    def listen(self, listener: Callable[[ParameterTable], None]) -> Unsubscribe:
        """Registers a listener for each new table, also after changes by another station."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener) if listener in self._listeners else None

    async def fetch(self, on_progress: OnProgress | None = None) -> ParameterTable:
        """Fetches the whole list.

        Raises:
            Refused: the vehicle does not answer, too much is lost, or it is being fetched already.
        """
        report = Quietly(on_progress)
        report("listing the parameters")
        self._client.encoding = (await self._snapshot.learn(self._machines)).encoding
        fetch = self._client.fetch(self._snapshot.snapshot.address, now_s=self._machines.now_s)

        def poll() -> None:
            if fetch.count:
                detail = f"{len(fetch.parameters)} of {fetch.count}"
                report("listing the parameters", fetch.progress, detail)

        try:
            await self._machines.until(lambda: fetch.result is not None, poll)
        finally:
            self._client.cancel(fetch)
        if fetch.result is not ParameterResult.DONE:
            raise Refused(f"the parameters were not listed: {fetch.result}")
        self._set_table(ParameterTable.of(fetch.parameters, self._infos(), is_complete=True))
        return self.table

    async def read(self, name: str) -> ParameterRow:
        """Reads one parameter again.

        Raises:
            Refused: there is no parameter of that name, or no answer.
        """
        self._client.encoding = (await self._snapshot.learn(self._machines)).encoding
        call = self._client.read(self._snapshot.snapshot.address, name, now_s=self._machines.now_s)
        return self._store_parameter(await self._finish(call, f"{name} was not read"))

    async def set(self, name: str, value: float, *, force: bool = False) -> ParameterRow:
        """Sets one parameter and reads it back.

        Args:
            name: which; the list must have been fetched.
            value: the new one.
            force: also beyond the bounds that the firmware describes.

        Raises:
            Refused: it may not be that, or the vehicle does not take it; with the reason.
        """
        wanted = self.table.check(name, value, force=force)
        target = self._snapshot.snapshot.address
        call = self._client.set(target, name, wanted.value, wanted.type, now_s=self._machines.now_s)
        try:
            await self._finish(call, f"{name} was not set")
        except Refused:
            if call.value is not None:
                self._store_parameter(call.value)
            raise
        call = self._client.read(target, name, now_s=self._machines.now_s)
        reported = await self._finish(call, f"{name} was set, but not read back")
        row = self._store_parameter(reported)
        if not reported.is_same(wanted):
            raise Refused(f"{name} was set, but is {row.text} now")
        return row

    async def write(self, changes: Sequence[ParameterChange], on_progress: OnProgress | None = None) -> WriteReport:
        """Sets several parameters, each read back; one that is refused does not keep the others from being set."""
        report = Quietly(on_progress)
        written: list[ParameterChange] = []
        refused: dict[str, str] = {}
        silent = 0
        for number, change in enumerate(changes):
            report("setting the parameters", number / len(changes), f"{number} of {len(changes)}: {change.name}")
            if silent >= MOST_SILENT:
                refused[change.name] = "not tried: the vehicle does not answer"
                continue
            try:
                await self.set(change.name, change.value)
            except Gloc3Error as error:
                refused[change.name] = str(error)
                silent = silent + 1 if ParameterResult.NO_ANSWER in str(error) else 0
            else:
                written.append(change)
                silent = 0
        restart = tuple(change.name for change in written if self.table[change.name].info.needs_restart)
        return WriteReport(written=tuple(written), refused=refused, needs_restart=restart)

    def compare(self, path: Path) -> ParameterDiff:
        """What loading a file would change; `write(diff.changes())` then does it.

        Raises:
            InputError: the file cannot be read; with everything that is wrong in it.
            Refused: the list has not been fetched.
        """
        if not self.table.is_complete:
            raise Refused("fetch the parameters first")
        return self.table.compare(load_parameter_file(path))

    def save(self, path: Path) -> int:
        """Saves all parameters in the format of the file's suffix.

        Returns:
            How many were saved.

        Raises:
            Refused: the list has not been fetched, the suffix is unknown, or the file cannot be written.
        """
        if not self.table.is_complete:
            raise Refused("fetch the parameters first")
        if path.suffix not in list(ParameterFormat):
            raise Refused(f"{path.name}: the file must end in {', '.join(ParameterFormat)}")
        snapshot = self._snapshot.snapshot
        rows = [row.parameter for row in self.table]
        text = write_parameter_file(rows, ParameterFormat(path.suffix), snapshot.address, [snapshot.title])
        try:
            path.write_text(text)
        except OSError as error:
            raise Refused(f"{path} cannot be written: {error.strerror or error}") from error
        return len(rows)

    def load_infos(self, path: Path) -> int:
        """Takes the firmware's description of its parameters from a file (`parameters.json`, `apm.pdef.xml`).

        Returns:
            How many of the vehicle's parameters it describes.

        Raises:
            InputError: it is none.
        """
        return self._use(load_infos(path))

    async def fetch_infos(self, on_progress: OnProgress | None = None) -> int:
        """Reads the description of the parameters from the vehicle itself: by its component metadata, or from `INFO_PATHS`.

        Returns:
            The number of the vehicle's parameters that it describes.

        Raises:
            Refused: the vehicle has no description, or a damaged one.
            InputError: its description is invalid.
        """
        try:
            return self._use(await self._metadata.parameters(on_progress))
        except NotOffered as error:
            reason = error
        for path in INFO_PATHS:
            try:
                data = await self._files.read(path, on_progress)
            except Refused:
                continue
            return self._use(read_infos(data, path))
        raise Refused(f"{reason}; load a description from a file")

    def _infos(self) -> Infos:
        snapshot = self._snapshot.snapshot
        return layered(self._own_infos, shipped_infos(snapshot.firmware, snapshot.vehicle_type))

    def _use(self, infos: Infos) -> int:
        self._own_infos = infos
        self._set_table(self.table.with_infos(self._infos()))
        return sum(bool(row.info.title) and not row.info.origin for row in self.table)

    async def _finish(self, call: ParameterCall, on_error: str) -> Parameter:
        try:
            await self._machines.until(lambda: call.result is not None)
        finally:
            self._client.cancel(call)
        if call.result is not ParameterResult.DONE or call.value is None:
            kept = "" if call.value is None else f" ({spell(call.value)})"
            raise Refused(f"{on_error}: {call.result}{kept}")
        return call.value

    def _store_parameter(self, reported: Parameter) -> ParameterRow:
        self._set_table(self.table.with_value(reported))
        return self.table[reported.name]

    def _set_table(self, table: ParameterTable) -> None:
        self.table = table
        for listener in tuple(self._listeners):
            listener(table)

    def _on_event(self, event: Any) -> None:
        """Another station has set a parameter; those of the vehicle's other components are not kept here."""
        if isinstance(event, Parameter) and event.name in self.table.rows:
            known = self._client.known.get(self._snapshot.snapshot.address, {})
            if known.get(event.name) is event:
                self._store_parameter(event)
