"""All services of one vehicle on one of the station's links."""

from typing import Final

from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.services.command_client import MavCommandClient
from gloc3.mavlink.services.files.ftp_client import FtpClient
from gloc3.mavlink.services.files.log_client import LogClient
from gloc3.mavlink.services.mission_client import MissionClient
from gloc3.mavlink.services.parameter_client import ParameterClient
from gloc3.mavlink.services.statustext import StatusTextReceiver
from gloc3.mavlink.shell import ShellClient
from gloc3_groundstation.services.actions import ActionService
from gloc3_groundstation.services.calibration.calibrations import CalibrationService
from gloc3_groundstation.services.cameras import CameraReceiver, CameraService
from gloc3_groundstation.services.console import ConsoleService
from gloc3_groundstation.services.descriptions.component_metadata import (
    DescriptionCache,
    MetadataClient,
    MetadataService,
)
from gloc3_groundstation.services.files import FileService
from gloc3_groundstation.services.home import HomeReceiver, HomeService
from gloc3_groundstation.services.logs import LogService
from gloc3_groundstation.services.machines import Machines, Wire
from gloc3_groundstation.services.mavsdk.behind_link import MavsdkBehindLink
from gloc3_groundstation.services.motor_test import MotorTestService
from gloc3_groundstation.services.parameters import ParameterService
from gloc3_groundstation.services.plans import PlanService
from gloc3_groundstation.services.rates import FrameRateMeter, RateService
from gloc3_groundstation.services.snapshot import ServicesSnapshot, SnapshotService


class VehicleServices:
    """Services of a vehicle, with or without a GLOC3 companion; each refuses unsupported requests with a reason.

    Args:
        wire: the link to the vehicle.
        target: its autopilot.
        descriptions: keeps descriptions of parameters that vehicles have sent; None for a cache of its own.
    """

    def __init__(self, wire: Wire, target: Address, descriptions: DescriptionCache | None = None) -> None:
        own = wire.own
        commands, parameters, files = MavCommandClient(own), ParameterClient(own), FtpClient(own)
        logs, mission = LogClient(own), MissionClient(own)
        self._snapshots = SnapshotService(own, target, commands)
        metadata, shell = MetadataClient(own, target), ShellClient(own, target)
        meter = FrameRateMeter()
        self.machines: Final = Machines(
            wire,
            target.system,
            [
                *(commands, parameters, files, logs, mission, metadata, shell, self._snapshots),
                *(StatusTextReceiver(own), HomeReceiver(own), CameraReceiver(own)),
            ],
            received=meter.count,
        )
        self._wire = wire
        self.ftp: Final = files
        """Files of the vehicle's companion or autopilot."""
        self.target: Final = target
        self.files: Final = FileService(self.machines, files, target)
        """The autopilot's files."""
        self.parameters: Final = ParameterService(
            self.machines,
            parameters,
            self._snapshots,
            self.files,
            self._descriptions(commands, metadata, descriptions or DescriptionCache(None)),
        )
        self.plans: Final = PlanService(self.machines, mission, self._snapshots)
        self.logs: Final = LogService(self.machines, logs, target, self._snapshots)
        self.console: Final = ConsoleService(self.machines, shell, self._snapshots)
        self._mavsdk = MavsdkBehindLink(wire, target)
        cameras = CameraService(self.machines, commands, target)
        self.actions: Final = ActionService(self.machines, commands, self._mavsdk, self._snapshots, cameras)
        self.motors: Final = MotorTestService(self.machines, commands, self._snapshots, target, self.actions)
        self.calibration: Final = CalibrationService(
            wire, self.machines, self._snapshots, self.parameters, self.actions
        )
        self.home: Final = HomeService(self.machines, commands, self.actions, target)
        self.rates: Final = RateService(self.machines, commands, meter, target)

    def _descriptions(
        self, commands: MavCommandClient, metadata: MetadataClient, cache: DescriptionCache
    ) -> MetadataService:
        """Reads descriptions of parameters from whichever component offers them."""
        return MetadataService(
            self.machines,
            commands,
            metadata,
            self.target,
            files=lambda owner: FileService(self.machines, self.ftp, owner),
            cache=cache,
        )

    @property
    def snapshots(self) -> ServicesSnapshot:
        """What is known of the vehicle now."""
        return self._snapshots.snapshot

    def send(self, message: MavlinkMessage) -> None:
        """Sends a message that needs no answer."""
        self._wire.send(message)

    async def learn(self) -> ServicesSnapshot:
        """Properties reported by the vehicle, requested if necessary; those that it does not report stay unknown."""
        return await self._snapshots.learn(self.machines)

    async def close(self) -> None:
        """Ends what is under way, which is refused, and MAVSDK's process."""
        self.calibration.close()
        self.console.leave()
        await self._mavsdk.close()
        self.machines.close()
