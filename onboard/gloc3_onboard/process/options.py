"""Options of an onboard process."""

from pathlib import Path

import msgspec

from gloc3.platform.platform import Platform
from gloc3_onboard.process.run_log import LogLimits


class ProcessOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options of `gloc3 onboard`."""

    platform: str
    autopilot: str
    stations: tuple[str, ...]
    acoustic: str = ""
    """Where an acoustic modem is; empty for none."""
    devices: tuple[str, ...] = ()
    """Sources that differ from the platform file's, as NAME=URL."""
    out: Path | None = None
    logs: Path | None = None
    """Where logs and pictures go; None for where the rest goes."""
    system_id: int = 1
    is_quiet: bool = False
    is_real_time: bool = False
    """Whether the control path has real-time priority."""
    signing_key: bytes | None = None
    """Of the links to ground stations; None for links that are not signed."""
    accepts_plans: bool = False
    """Plans that stations of others send to the autopilot become missions, and do not reach it."""
    terrain: Path | None = None
    """Folder of terrain tiles; None without."""
    log_limits: LogLimits = LogLimits()
    host: str | None = None
    """Which of the platform's hosts this is; None for the only one."""
    metrics: str = ""
    """HOST:PORT where metrics for Prometheus are served; empty for nowhere."""
    video: str = ""
    """ADDRESS:PORT where the cameras' video is served; empty for nowhere."""
    network: Path | None = None
    """The network file of this host; None where nothing leaves this computer but MAVLink."""

    def folder(self, platform: Platform) -> Path:
        """Where state and logs are."""
        return self.out or Path(f"gloc3-{platform.platform}")
