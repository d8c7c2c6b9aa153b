"""A bench for the simulated vehicle: one MAVLink client on a direct link, time moved by hand."""

from collections import Counter
from collections.abc import Callable, Sequence
from math import dist, nan
from typing import Any

from gloc3.mavlink.codec import Encoder, Parser, message
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.services.mission_client import MissionClient, Transfer
from gloc3.mavlink.services.plan import FRAME_MISSION, PlanItem, PlanResult, PlanType
from gloc3.messages.frames import TangentPlane, Vector3
from gloc3.mission.formats.commands import COMMANDS
from gloc3_sitl.autopilot.mavlink.links import LinkKind
from gloc3_sitl.autopilot.modes import Result
from gloc3_sitl.autopilot.pilot import Pilot
from gloc3_sitl.vehicles.simulator import Simulator, SimulatorSettings
from gloc3_sitl.world import World

POSITION_AND_VELOCITY = 0b100111000000
"""Type mask: position, velocity and yaw are set; acceleration and yaw rate are not."""
POSITION = 0b100111111000
VELOCITY = 0b100111000111
ARM, TAKE_OFF, LAND, SET_MODE, REPOSITION = 400, 22, 21, 176, 192
VEHICLE = Address(1, 1)


class Bench:
    """A vehicle in the open, and what its MAVLink client sends and has heard."""

    def __init__(self, style: str | None = "px4", *, system: int = 1, component: int = 191, **settings: Any) -> None:
        self.sim = Simulator(
            settings.pop("world", World.load("open")), SimulatorSettings(style=style, **{"seed": 7, **settings})
        )
        self.is_px4 = self.sim.style == "px4"
        self.received: list[MavlinkMessage] = []
        self.counts: Counter[str] = Counter()
        self._parser = Parser(is_datagram=True)
        self._encoder = Encoder(system, component)
        self._receive = self.sim.attach(self._handle, LinkKind.BARE)
        self.send("HEARTBEAT", type=18, autopilot=8)

    @property
    def autopilot(self) -> Any:
        return self.sim.autopilot

    @property
    def pilot(self) -> Pilot:
        return self.sim.pilot

    @property
    def mode(self) -> str:
        return self.sim.autopilot.commander.mode.name

    @property
    def is_armed(self) -> bool:
        return self.sim.autopilot.craft.is_armed

    @property
    def is_landed(self) -> bool:
        return self.sim.autopilot.craft.is_landed

    @property
    def position(self) -> Vector3:
        """Where the vehicle truly is, NED from home."""
        return self.sim.truth().position_ned_m

    @property
    def texts(self) -> list[str]:
        return [text for _, _, text in self.sim.texts]

    def _handle(self, data: bytes) -> None:
        for frame in self._parser.receive(data):
            received = frame.decode()
            if received is not None:
                self.received.append(received)
                self.counts[received.name] += 1

    def last(self, name: str) -> MavlinkMessage:
        return next(received for received in reversed(self.received) if received.name == name)

    def send(self, name: str, **fields: Any) -> None:
        self._receive(self._encoder.encode(message(name, **fields)))

    def send_message(self, out: MavlinkMessage) -> None:
        self._receive(self._encoder.encode(out))

    def run(self, seconds: float) -> None:
        self.sim.advance(self.sim.now_s + seconds)

    def run_until(self, condition: Callable[[], bool], within_s: float) -> float:
        """Runs until something is true; gives the time that it took."""
        begin = self.sim.now_s
        while not condition():
            assert self.sim.now_s - begin < within_s, f"not within {within_s} s; said: {self.texts[-5:]}"
            self.run(0.02)
        return self.sim.now_s - begin

    def command(self, command: int, *params: float, as_int: dict[str, Any] | None = None) -> Result:
        """Sends a command; gives the result of its last acknowledgement."""
        values = {f"param{index}": value for index, value in enumerate(params, start=1)}
        name = "COMMAND_LONG" if as_int is None else "COMMAND_INT"
        self.run(0.3)  # so that the same command again is no repeat
        before = self.counts["COMMAND_ACK"]
        self.send(name, target_system=1, target_component=1, command=command, **values, **(as_int or {}))
        assert self.counts["COMMAND_ACK"] == before + 1
        ack = self.last("COMMAND_ACK")
        assert ack.command == command
        return Result(ack.result)

    def set_mode(self, name: str) -> Result:
        mode = self.sim.autopilot.style.mode_named(name)
        assert mode is not None
        if self.is_px4:
            return self.command(SET_MODE, 1, mode.custom_mode >> 16 & 0xFF, mode.custom_mode >> 24)
        return self.command(SET_MODE, 1, mode.custom_mode)

    def set_parameter(self, name: str, value: float) -> None:
        self.sim.autopilot.parameters.set(name, value)

    def get_ready(self) -> None:
        """Waits until the vehicle may be armed."""
        self.run_until(lambda: self.sim.now_s > 2.0 and not self.sim.autopilot.commander.problems(), 10.0)

    def take_off(self, height_m: float = 2.5) -> None:
        """Arms and climbs, as the style wants it."""
        if self.is_px4:
            self.get_ready()
            self.set_parameter("MIS_TAKEOFF_ALT", height_m)
            assert self.command(ARM, 1) is Result.ACCEPTED
            assert self.command(TAKE_OFF, nan, 0, 0, nan, nan, nan, nan) is Result.ACCEPTED
            self.run_until(lambda: self.mode == "Hold", 20.0 + height_m)
        else:
            self.run_until(lambda: bool(self.autopilot.estimator.is_position_good(self.autopilot.craft.now_s)), 10.0)
            assert self.set_mode("GUIDED") is Result.ACCEPTED
            self.get_ready()
            assert self.command(ARM, 1) is Result.ACCEPTED
            assert self.command(TAKE_OFF, 0, 0, 0, 0, 0, 0, height_m) is Result.ACCEPTED
            self.run_until(lambda: abs(self.position[2] + height_m) < 0.2, 20.0 + height_m)
        self.run(2.0)

    def stream(
        self,
        setpoint: Callable[[float], tuple[Vector3, Vector3]],
        seconds: float,
        *,
        rate_hz: float = 20.0,
        mask: int = POSITION_AND_VELOCITY,
        yaw: float = 0.0,
    ) -> list[float]:
        """Streams setpoints (position and velocity by the time since the beginning); gives the true errors in metres."""
        errors = []
        begin = self.sim.now_s
        for count in range(round(seconds * rate_hz)):
            (x, y, z), (vx, vy, vz) = setpoint(count / rate_hz)
            self.send(
                "SET_POSITION_TARGET_LOCAL_NED",
                target_system=1,
                target_component=1,
                coordinate_frame=1,
                type_mask=mask,
                x=x,
                y=y,
                z=z,
                vx=vx,
                vy=vy,
                vz=vz,
                yaw=yaw,
            )
            self.sim.advance(begin + (count + 1) / rate_hz)
            errors.append(dist(self.position, (x, y, z)))
        return errors

    def upload(self, items: Sequence[PlanItem], kind: PlanType = PlanType.MISSION) -> PlanResult:
        """Uploads a plan; gives how that ended."""
        client = MissionClient(Address(1, 191))
        transfer = client.upload(VEHICLE, tuple(items), now_s=self.sim.now_s, kind=kind)
        return self._finish(client, transfer)

    def download(self, kind: PlanType = PlanType.MISSION) -> tuple[PlanItem, ...]:
        """Reads a plan back."""
        client = MissionClient(Address(1, 191))
        transfer = client.download(VEHICLE, now_s=self.sim.now_s, kind=kind)
        assert self._finish(client, transfer) is PlanResult.ACCEPTED
        return transfer.items

    def _finish(self, client: MissionClient, transfer: Transfer) -> PlanResult:
        seen = len(self.received)
        while transfer.result is None:
            for out in client.outgoing():
                self._receive(self._encoder.encode(out))
            for received in self.received[seen:]:
                if received.name in client.handles:
                    client.receive(received, VEHICLE, self.sim.now_s)
            seen = len(self.received)
            self.run(0.02)
            client.tick(self.sim.now_s)
        for out in client.outgoing():
            self._receive(self._encoder.encode(out))
        return transfer.result

    def item(
        self, command: int, north_m: float = 0.0, east_m: float = 0.0, height_m: float = 3.0, **fields: Any
    ) -> PlanItem:
        """A plan item at a place given from home, with its height over home; in MAV_FRAME_MISSION if its command has none."""
        known = COMMANDS.get(command)
        place = TangentPlane(self.sim.world.home).geo_from_ned((north_m, east_m, 0.0))
        values = {
            "frame": 6 if known is None or known.has_position else FRAME_MISSION,
            "param4": nan,
            "x": round(place.latitude_deg * 1e7),
            "y": round(place.longitude_deg * 1e7),
            "z": height_m,
        }
        return PlanItem(command=command, **{**values, **fields})

    def start_streaming(self, place: Vector3) -> None:
        """Enters streamed control, holding a place."""

        def hold(_: float) -> tuple[Vector3, Vector3]:
            return place, (0.0, 0.0, 0.0)

        self.stream(hold, 0.8)
        assert self.set_mode("Offboard" if self.is_px4 else "GUIDED") is Result.ACCEPTED
        self.stream(hold, 2.0)
