"""What `gloc3 onboard` can be asked for, as its command line takes it; `gloc3 onboard install` takes the same."""

from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Annotated, Final

from cyclopts import Parameter

from gloc3.errors import Refused

DEFAULT_AUTOPILOT: Final = "udpin://0.0.0.0:14540"
DEFAULT_STATION: Final = "udpout://127.0.0.1:14550"
MOST_SYSTEM_ID: Final = 250

Flag = Annotated[bool, Parameter(negative=())]
Several = Annotated[list[str], Parameter(negative=(), show_default=False)]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OnboardOptions:
    """The options of `gloc3 onboard`."""

    autopilot: str = DEFAULT_AUTOPILOT
    """Where the autopilot is: udpin://HOST:PORT, udpout://, tcpin://, tcpout:// or serial:///dev/PORT:BAUD; with :auto
    as BAUD the rate is found. ?key=FILE behind it signs the link with that key."""
    station: Several = field(default_factory=list)
    """Where ground stations are; may be given again. Default: udpout://127.0.0.1:14550. Behind it ?rate=BIT_S tells what
    a radio on the way carries, ?key=FILE (or &key=FILE) goes before --signing-key, and with ?role=observer those on the
    link may look, and command neither platform nor autopilot."""
    acoustic: str = ""
    """Where an acoustic modem is, as udpout://HOST:PORT or serial:///dev/PORT:BAUD: while no station is heard otherwise, a
    summary of 32 bytes goes there once a minute, and orders to hold or surface are taken. ?key=FILE tags its frames."""
    device: Several = field(default_factory=list)
    """Where a sensor's data comes from, as NAME=URL, such as ground_camera=v4l2:///dev/video0; may be given again. It
    goes before what the platform file says. docs/sensors.md lists the URLs."""
    host: str | None = None
    """Which of the platform's hosts this computer is; only the one with the autopilot has links to it and to stations.
    Default: the only one."""
    network: Path | None = None
    """The network file of this host, as `gloc3 network init` and `add` make it: joins the platform's hosts with each
    other and with stations."""
    out: Path | None = None
    """Folder for the log, pictures and state; default: gloc3-PLATFORM here."""
    logs: Path | None = None
    """Another folder for logs and pictures; default: that of --out."""
    system_id: int = 1
    """The vehicle's MAVLink system; this process is component 191 of it."""
    signing_key: Path | None = None
    """A file with the MAVLink signing key of the links to ground stations, which nobody else may read: 64 hexadecimal
    digits, or `passphrase: ...`; the stations have the same. Then frames without its signature are dropped and told."""
    take_plans: Flag = False
    """Plans that ground stations of others (QGroundControl, say) send to the autopilot become missions of this process,
    and do not reach the autopilot. Without it they become missions only when sent to component 191."""
    log_size: float = 500.0
    """A log of more megabytes is followed by the next file of the run; 0 for no limit."""
    log_total: float = 10_000.0
    """Beyond so many megabytes of logs in the folder the oldest are deleted, never the one that is being written, and no
    pictures; 0 to keep all."""
    quiet: Flag = False
    """No narration on stderr."""

    def check(self) -> None:
        """Checks numbers and links.

        Raises:
            Refused: one cannot be.
        """
        from gloc3.mavlink.transport.endpoints import parse_url

        for url in (self.autopilot, *self.station, *filter(None, (self.acoustic,))):
            parse_url(url)
        if not 1 <= self.system_id <= MOST_SYSTEM_ID:
            raise Refused(f"--system-id must be from 1 to {MOST_SYSTEM_ID}; those above are stations'")
        for name, value in (("--log-size", self.log_size), ("--log-total", self.log_total)):
            if not 0.0 <= value < inf:
                raise Refused(f"{name} must be 0 or more megabytes")
