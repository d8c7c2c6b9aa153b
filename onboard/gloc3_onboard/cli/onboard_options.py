"""Options of `gloc3 onboard` on its command line; `gloc3 onboard install` takes the same."""

from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Annotated, Final

from cyclopts import Parameter

from gloc3.errors import Refused

DEFAULT_AUTOPILOT: Final = "udpin://127.0.0.1:14540"
DEFAULT_STATION: Final = "udpout://127.0.0.1:14550"
MOST_SYSTEM_ID: Final = 250

Flag = Annotated[bool, Parameter(negative=())]
Several = Annotated[list[str], Parameter(negative=(), show_default=False)]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OnboardOptions:
    """The options of `gloc3 onboard`."""

    autopilot: str = DEFAULT_AUTOPILOT
    """Link to the autopilot: udpin://HOST:PORT, udpout://, tcpin://, tcpout:// or serial:///dev/PORT:BAUD; with :auto
    as BAUD the rate is detected. Append ?key=FILE to sign the link with that key."""
    station: Several = field(default_factory=list)
    """Link to ground stations; repeatable. Default: udpout://127.0.0.1:14550, and none with --network. Append ?rate=BIT_S for the bandwidth of
    a radio link, ?key=FILE (or &key=FILE) to override --signing-key; with ?role=observer stations on the
    link can watch, but command neither platform nor autopilot."""
    acoustic: str = ""
    """Acoustic modem link, as udpout://HOST:PORT or serial:///dev/PORT:BAUD: while no station is heard elsewhere, a
    summary of 32 bytes is sent once a minute, and orders to hold or surface are accepted. ?key=FILE tags its frames."""
    device: Several = field(default_factory=list)
    """Source of a sensor's data, as NAME=URL, such as ground_camera=v4l2:///dev/video0; repeatable. It
    overrides the platform file. docs/sensors.md lists the URLs."""
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
    """MAVLink system id of the vehicle; this process is its component 191."""
    signing_key: Path | None = None
    """File with the MAVLink signing key of the links to ground stations, readable by its owner only: 64 hex
    digits, or `passphrase: ...`; the stations use the same. Unsigned frames are then dropped and reported."""
    take_plans: Flag = False
    """Plans that other ground stations (QGroundControl, say) send to the autopilot become missions of this process,
    and do not reach the autopilot. Without it they become missions only when sent to component 191."""
    terrain: Path | None = None
    """Folder with terrain tiles (SRTM .hgt or .hgt.zip), for missions with heights above the ground, and to check
    others against the ground; none is downloaded."""
    log_size: float = 500.0
    """Size of a log in megabytes at which the run continues in the next file; 0 for no limit."""
    log_total: float = 10_000.0
    """Total size of the folder's logs in megabytes above which the oldest are deleted, never the current one and no
    pictures; 0 to keep all."""
    metrics: str = ""
    """Serve metrics for Prometheus over HTTP at HOST:PORT, such as 127.0.0.1:9100: states, rates, cycle times and losses
    of the components, links, battery, memory; docs/onboard-service.md. They are neither encrypted nor protected."""
    video: str = ""
    """Serve the video of the cameras that the mission may record over RTSP at ADDRESS:PORT, such as 127.0.0.1:8554;
    VIDEO_STREAM_INFORMATION has this address. Needs PyAV (pip install gloc3[video]). It is neither encrypted nor protected."""
    real_time: Flag = False
    """Real-time priority (SCHED_RR) for the control path, which is the event loop and the required components; for the
    host with the autopilot, on Linux. It needs the right to it: `ulimit -r 10`; a service that is installed so has it."""
    quiet: Flag = False
    """No narration on stderr."""

    def check(self) -> None:
        """Checks numbers and links.

        Raises:
            Refused: one cannot be.
        """
        from gloc3.mavlink.transport.endpoints import parse_url

        if self.metrics:
            from gloc3_onboard.process.metrics import parse_address

            parse_address(self.metrics)
        if self.video:
            from gloc3_onboard.video.streams import read_address

            read_address(self.video)
        for url in (self.autopilot, *self.station, *filter(None, (self.acoustic,))):
            parse_url(url)
        if not 1 <= self.system_id <= MOST_SYSTEM_ID:
            raise Refused(f"--system-id must be from 1 to {MOST_SYSTEM_ID}; those above are stations'")
        for name, value in (("--log-size", self.log_size), ("--log-total", self.log_total)):
            if not 0.0 <= value < inf:
                raise Refused(f"{name} must be 0 or more megabytes")
