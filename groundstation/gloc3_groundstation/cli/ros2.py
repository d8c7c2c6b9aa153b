"""The command `gloc3 ros2`: vehicles in the graph of ROS 2, without a ROS installation."""

import asyncio
import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import App, Parameter
from cyclopts.validators import Number

from gloc3.cli.narration import narrate
from gloc3.errors import Refused

if TYPE_CHECKING:
    from gloc3.ros2.node import RosNetwork
    from gloc3_groundstation.assembly import StationSetup
    from gloc3_groundstation.cli.ending import Ending

FLAG: Final = Parameter(negative=(), show_default=False)
LINK: Final = "udpin://127.0.0.1:14550"

app = App(
    name="gloc3 ros2",
    help="""Show vehicles to ROS 2, and let it command their missions; ROS 2 need not be installed here.

    The bridge is a station. On the side of ROS 2 it is a node that speaks the wire of rmw_zenoh, so the other nodes run
    with RMW_IMPLEMENTATION=rmw_zenoh_cpp, and a router (ros2 run rmw_zenoh_cpp rmw_zenohd) runs at --router. Topics are
    requested from a vehicle only while a node subscribes to them.

    - `/PLATFORM/pose`: nav_msgs/Odometry; and /tf
    - `/PLATFORM/imu`, `laser`, `satellites`, `height`, `battery`, `camera/NAME/compressed`: sensor_msgs
    - `/diagnostics`: every component of every vehicle, once a second
    - `/PLATFORM/mission/start`, `pause`, `resume`, `abort`, `state`: std_srvs/srv/Trigger; a refusal has its reason

    For example, beside `gloc3 sitl` and `gloc3 onboard pelican_rtk`:

    - `gloc3 ros2`: then, in ROS 2, `ros2 topic echo /pelican/pose` and
      `ros2 service call /pelican/mission/state std_srvs/srv/Trigger`
    - `gloc3 ros2 --mission inspection`: start uploads that mission first
    - `gloc3 ros2 --network station.yaml --read-only`: over the encrypted network; commands nothing

    Nodes of ROS 2 that are sensors of a vehicle (odometry, scans), or that are to be components of it, are named in its
    platform file; docs/ros2.md shows how.""",
    help_format="markdown",
    version_flags=[],
)
app["--help"].group = "Parameters"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class RosOptions:
    """Options of `gloc3 ros2`, one for each field."""

    link: Annotated[list[str] | None, Parameter(negative=())] = None
    """MAVLink link to the vehicles, as of gloc3 station; may be given again. Default: udpin://127.0.0.1:14550, unless
    --network is given."""
    network: Path | None = None
    """The network file of this station, made by gloc3 network: an encrypted connection to the platforms."""
    station_id: Annotated[int, Parameter(validator=Number(gte=200, lte=255))] = 254
    """The MAVLink system of this station; unique among stations. The operator's is 255."""
    signing_key: Path | None = None
    """A file with the MAVLink signing key of all links."""
    mission: Path | None = None
    """Mission file, or the name of an example, that the service start uploads first. Default: it starts the mission that
    is loaded."""
    read_only: Annotated[bool, FLAG] = False
    """Offer no services: ROS 2 commands nothing."""
    rate: Annotated[float, Parameter(validator=Number(gte=0.1, lte=100.0))] = 20.0
    """Messages a second that are requested of a topic, at most."""
    router: str = "tcp/localhost:7447"
    """Where the router of ROS 2 is, as a Zenoh endpoint."""
    domain: Annotated[int, Parameter(validator=Number(gte=0, lte=232))] = 0
    """ROS_DOMAIN_ID."""
    node: str = "/gloc3"
    """The name of the node."""
    humble: Annotated[bool, FLAG] = False
    """The other nodes are of ROS 2 Humble, which has no type hashes."""
    zenoh_config: Path | None = None
    """A Zenoh configuration file for the side of ROS 2, in place of --router, such as for TLS: the one of
    ZENOH_SESSION_CONFIG_URI."""


@app.default
def ros2(options: RosOptions = RosOptions()) -> int:
    """Show vehicles to ROS 2."""
    from gloc3.ros2.node import RosNetwork
    from gloc3_groundstation.cli.ending import Ending

    network = RosNetwork(
        router=options.router, domain=options.domain, is_humble=options.humble, config=options.zenoh_config
    )
    with Ending() as ending:
        return asyncio.run(_run(options, _setup(options), network, ending))


async def _run(options: RosOptions, setup: "StationSetup", network: "RosNetwork", ending: "Ending") -> int:
    """Bridges until the end is requested."""
    from gloc3.clock import Clock
    from gloc3.ros2.node import open_node
    from gloc3_groundstation.assembly import GroundStation
    from gloc3_groundstation.ros2.bridge import RosBridge
    from gloc3_groundstation.ros2.missions import MissionServices

    ended = asyncio.Event()
    ground = GroundStation(setup, narrate)
    try:
        await ground.open(options.link or ([] if setup.network is not None else [LINK]))
        with open_node(network, options.node) as node:
            desk = ground.desk()
            missions = None if options.read_only else MissionServices(desk, node, options.mission)
            bridge = RosBridge(desk, node, Clock(ground.loop).utc_s, options.rate, narrate, missions)
            narrate(f"{node.name} in domain {network.domain} of ROS 2 at {network.config or network.router}")
            narrate(f"listening on {ground.links.describe()}")
            if missions is not None and network.config is None:
                narrate(
                    "warning: every node at that router can command missions; --read-only or --zenoh-config prevent it"
                )
            with ending.requested(ended.set):
                bridge.open()
                await ended.wait()
            bridge.close()
    finally:
        await ground.close()
    return 0


def _setup(options: RosOptions) -> "StationSetup":
    """What the station is.

    Raises:
        InputError: a file cannot be read.
        Refused: there is no such mission, or options do not go together.
    """
    from gloc3.mavlink.signing_key import read_signing_key
    from gloc3.mission.examples import find_mission
    from gloc3_groundstation.assembly import StationSetup, read_membership

    if options.mission is not None:
        find_mission(str(options.mission))
    if options.mission is not None and options.read_only:
        raise Refused("--mission goes without --read-only")
    if options.zenoh_config is not None and not options.zenoh_config.is_file():
        raise Refused(f"--zenoh-config {options.zenoh_config}: there is no such file")
    return StationSetup(
        boot=secrets.randbits(32),
        system=options.station_id,
        signing_key=None if options.signing_key is None else read_signing_key(options.signing_key.expanduser()),
        network=read_membership(options.network),
    )
