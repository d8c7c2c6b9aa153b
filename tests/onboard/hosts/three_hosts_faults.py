"""What goes wrong with three hosts and the lines between them, and what is to follow, stated before it is flown."""

import signal
import subprocess
from collections.abc import Callable
from typing import Final, NamedTuple

from tests.onboard.hosts import namespaces
from tests.onboard.hosts.managed import Manager
from tests.onboard.hosts.namespaces import BASE, VEHICLE, VISION

RADIO: Final = "radio"
GOES_ON, HOLDS, LANDS, EITHER = "goes on", "holds", "ends", "goes on, or holds where the host is lost"


class Scene(NamedTuple):
    """What a fault may touch."""

    mains: dict[str, Manager]
    relays: dict[str, "subprocess.Popen[str]"]
    """By the host behind them; of the station's link `radio`."""

    def report(self, relay: str, *lines: str) -> None:
        """Has a relay do something."""
        reported = self.relays[relay].stdin
        assert reported is not None
        reported.write("".join(f"{line}\n" for line in lines))
        reported.flush()

    def signal(self, host: str, number: int) -> None:
        """Sends a signal to a host's main process and its children."""
        self.mains[host].program.interrupt(number)


Act = Callable[[Scene], None]


class Fault(NamedTuple):
    """Something that is wrong for a while, and what is to follow."""

    name: str
    host: str
    for_s: float
    begin: Act
    end: Act
    is_lost: bool | None
    """Whether the host is to be told to be lost; None where either may be."""
    mission: str
    """What becomes of it."""
    policy: str
    """Why."""


def _heal(relay: str) -> Act:
    return lambda scene: scene.report(relay, "heal")


def _signal(host: str, number: int) -> Act:
    return lambda scene: scene.signal(host, number)


def _nothing(_: Scene) -> None:
    """It ends by itself."""


IGNORE, HOLD = "`on_loss: ignore`", "`on_loss: hold`, until the operator says resume"
BLIND: Final = "the autopilot gets no pose for 0.5 s, and lands by itself"
STILL: Final = "nobody is lost, nothing follows"


def _on_the_way_to_vision() -> tuple[Fault, ...]:
    def bucket(_: Scene) -> None:
        namespaces.shape(VISION, "tbf", "rate", "2mbit", "burst", "16kb", "latency", "200ms")

    def whole(_: Scene) -> None:
        namespaces.shape(VISION)

    return (
        Fault("relay: 0.1 s later, 250 kB/s at most", VISION, 6.0, lambda scene: scene.report(VISION, "delay 0.1", "rate 250000"), _heal(VISION), False, GOES_ON, STILL),
        Fault("relay: parted", VISION, 10.0, lambda scene: scene.report(VISION, "partition"), _heal(VISION), True, GOES_ON, IGNORE),
        Fault("relay: connection reset", VISION, 0.5, lambda scene: scene.report(VISION, "reset"), _nothing, True, GOES_ON, IGNORE),
        Fault("token bucket on the line, 2 Mbit/s", VISION, 6.0, bucket, whole, False, GOES_ON, STILL),
        Fault("SIGSTOP", VISION, 5.0, _signal(VISION, signal.SIGSTOP), _signal(VISION, signal.SIGCONT), True, GOES_ON, IGNORE),
        Fault("SIGKILL", VISION, 0.0, _signal(VISION, signal.SIGKILL), _nothing, True, GOES_ON, IGNORE),
    )  # fmt: skip


def _on_the_vehicle() -> tuple[Fault, ...]:
    return (
        Fault("radio link of the station: 30 % lost, both ways", RADIO, 10.0, lambda scene: scene.report(RADIO, "loss 0.3"), _heal(RADIO), False, GOES_ON, "commands are repeated, and executed once"),
        Fault("SIGSTOP", VEHICLE, 0.3, _signal(VEHICLE, signal.SIGSTOP), _signal(VEHICLE, signal.SIGCONT), None, GOES_ON, "nobody was silent"),
        Fault("SIGKILL", VEHICLE, 0.0, _signal(VEHICLE, signal.SIGKILL), _nothing, None, LANDS, BLIND),
    )  # fmt: skip


LINE_DOWN: Final = Fault("line down", BASE, 8.0, lambda _: namespaces.line(BASE, "down"), lambda _: namespaces.line(BASE, "up"), True, HOLDS, HOLD)  # fmt: skip


def _on_the_way_to_base() -> tuple[Fault, ...]:
    return (
        Fault("QUIC over UDP: 30 % lost, both ways", BASE, 10.0, lambda scene: scene.report(BASE, "loss 0.3"), _heal(BASE), None, EITHER, f"what is lost is sent again; after 2 s without a word {HOLD}"),
        LINE_DOWN,
        Fault("SIGSTOP", BASE, 5.0, _signal(BASE, signal.SIGSTOP), _signal(BASE, signal.SIGCONT), True, HOLDS, HOLD),
        Fault("SIGKILL", BASE, 0.0, _signal(BASE, signal.SIGKILL), _nothing, True, HOLDS, HOLD),
        Fault("SIGSTOP", VEHICLE, 3.0, _signal(VEHICLE, signal.SIGSTOP), _signal(VEHICLE, signal.SIGCONT), None, LANDS, BLIND),
    )  # fmt: skip


FAULTS: Final = {VISION: (*_on_the_way_to_vision(), *_on_the_vehicle()), BASE: _on_the_way_to_base()}
"""By the host of the stereo odometer."""


def emulated(has_netem: bool) -> dict[str, tuple[Fault, ...]]:
    """All of them, with the kernel's emulator where it has one."""
    if not has_netem:
        return FAULTS

    def lossy(_: Scene) -> None:
        namespaces.shape(VISION, "netem", "loss", "30%", "delay", "50ms")

    netem = Fault("netem: 30 % lost, 50 ms later (TCP)", VISION, 6.0, lossy, lambda _: namespaces.shape(VISION), None, GOES_ON, IGNORE)  # fmt: skip
    return {**FAULTS, VISION: (*FAULTS[VISION], netem)}
