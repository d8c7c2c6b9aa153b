"""Inventory of a vehicle: versions, digests, hours and battery, for stations that ask for it."""

from typing import Final

import msgspec

from gloc3.messages.command_interface import Inventory
from gloc3.messages.software import own_software
from gloc3.store import DocumentFile
from gloc3_onboard.command_server.observing import Observing
from gloc3_onboard.command_server.site import Site, Usage

KEEP_S: Final = 60.0
"""Period at which the hours are kept, s: a power cut loses no more."""


class UsageMeter:
    """Counts the hours of a vehicle.

    Args:
        file: keeps them; None for nowhere.
    """

    def __init__(self, file: DocumentFile[Usage] | None) -> None:
        self._file = file
        self.usage = (file.read() if file is not None else None) or Usage()
        self._observed_s: float | None = None
        self._kept_s = 0.0
        self._was_armed = False

    def observe(self, now_s: float, *, is_armed: bool) -> None:
        """Counts the time since the last call."""
        elapsed_s = 0.0 if self._observed_s is None else max(now_s - self._observed_s, 0.0)
        if self._observed_s is None:
            self._kept_s = now_s
        self._observed_s = now_s
        usage, has_changed = self.usage, is_armed != self._was_armed
        self.usage = Usage(
            powered_s=usage.powered_s + elapsed_s,
            armed_s=usage.armed_s + (elapsed_s if self._was_armed else 0.0),
            armings=usage.armings + (has_changed and is_armed),
        )
        self._was_armed = is_armed
        if has_changed or now_s - self._kept_s >= KEEP_S:
            self._kept_s = now_s
            if self._file is not None:
                self._file.write(self.usage)


class VehicleInventory:
    """What a station is told about the vehicle.

    Args:
        site: the platform.
        observing: knows the autopilot.
    """

    def __init__(self, site: Site, observing: Observing) -> None:
        self._platform, self._digest, self._observing = site.platform, site.platform.digest(), observing
        self._meter = UsageMeter(site.usage)

    def observe(self, now_s: float) -> None:
        """Counts hours."""
        autopilot = self._observing.snapshot.known_autopilot
        self._meter.observe(now_s, is_armed=autopilot is not None and autopilot.is_connected and autopilot.is_armed)

    def read(self) -> Inventory:
        """As it is now."""
        own, setup, autopilot = own_software(), self._observing.setup, self._observing.snapshot.known_autopilot
        usage = self._meter.usage
        found = Inventory(
            version=own.version,
            protocol=own.protocol,
            platform_digest=self._digest,
            components=len(self._platform.components),
            hosts=sorted(self._observing.hosts),
            powered_s=round(usage.powered_s, 1),
            armed_s=round(usage.armed_s, 1),
            armings=usage.armings,
        )
        if setup is not None and setup.style is not None:
            numbers = "" if setup.firmware is None else " " + ".".join(map(str, setup.firmware))
            firmware = f"{setup.style}{numbers}{'' if setup.is_official else ' (not a release)'}"
            found = msgspec.structs.replace(found, firmware=firmware)
        if autopilot is None:
            return found
        remaining = autopilot.battery_remaining
        return msgspec.structs.replace(
            found,
            battery_percent=round(100.0 * remaining) if remaining >= 0.0 else -1,
            battery_v=round(autopilot.battery_v, 2),
        )
