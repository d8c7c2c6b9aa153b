"""State of the onboard computer, from Linux's /proc: processor load, memory, disk, time since its start."""

import shutil
from pathlib import Path
from typing import Final

import msgspec

PROC: Final = Path("/proc")
MIB: Final = 1 << 20
KIB_A_MIB: Final = 1024
UNKNOWN: Final = 255
"""MAVLink's word for a share that is not known (UINT8_MAX)."""


class Vitals(msgspec.Struct, frozen=True, kw_only=True):
    """Figures of one moment; 0 or None where unknown."""

    uptime_s: float = 0.0
    cpu_percent: int | None = None
    """Load of all cores since the previous sample; None at the first."""
    memory_used_mib: int = 0
    memory_total_mib: int = 0
    disk_used_mib: int = 0
    disk_total_mib: int = 0


class VitalSigns:
    """Reads the computer's state now and then.

    Args:
        folder: whose disk counts.
        proc: where Linux tells these things.
    """

    def __init__(self, folder: Path, proc: Path = PROC) -> None:
        self._folder, self._proc = folder, proc
        self._ticks: tuple[int, int] | None = None

    def sample(self) -> Vitals:
        """The current figures; unknown ones are left out."""
        found = Vitals()
        for part in (self._uptime, self._cpu, self._memory, self._disk):
            try:
                found = msgspec.structs.replace(found, **part())
            except (OSError, ValueError, IndexError, KeyError):  # another system, or a file that is not as Linux's
                continue
        return found

    def _uptime(self) -> dict[str, float]:
        return {"uptime_s": float((self._proc / "uptime").read_text().split()[0])}

    def _cpu(self) -> dict[str, int | None]:
        ticks = [int(word) for word in (self._proc / "stat").read_text().splitlines()[0].split()[1:9]]
        busy, total = sum(ticks) - ticks[3] - ticks[4], sum(ticks)  # all but idle and waiting for a disk
        before, self._ticks = self._ticks, (busy, total)
        if before is None or total <= before[1]:
            return {"cpu_percent": None}
        return {"cpu_percent": max(0, min(100, round(100.0 * (busy - before[0]) / (total - before[1]))))}

    def _memory(self) -> dict[str, int]:
        rows = dict(line.split(":", 1) for line in (self._proc / "meminfo").read_text().splitlines())
        total, free = (int(rows[name].split()[0]) // KIB_A_MIB for name in ("MemTotal", "MemAvailable"))
        return {"memory_used_mib": total - free, "memory_total_mib": total}

    def _disk(self) -> dict[str, int]:
        usage = shutil.disk_usage(next(one for one in (self._folder, *self._folder.absolute().parents) if one.is_dir()))
        return {"disk_used_mib": usage.used // MIB, "disk_total_mib": usage.total // MIB}
