"""Identifies the autopilot on a link: its family and vehicle class, and when it is lost or replaced."""

from collections.abc import Iterator
from enum import Enum, auto
from typing import Final

from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.services.heartbeat import MavlinkPeers, PeerChange
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import Cause, EventReport
from gloc3_onboard.autopilot.families import NOT_SUPPORTED, style_of
from gloc3_onboard.autopilot.px4 import Px4
from gloc3_onboard.autopilot.style import AutopilotStyle


class IdentityChange(Enum):
    """A change of the autopilot's identity."""

    FOUND = auto()
    """There was none before."""
    REPLACED = auto()
    """It is of another family or class than before, as after another firmware was loaded."""
    UNSUPPORTED = auto()
    """It has become one that is not supported."""
    RESTARTED = auto()
    RETURNED = auto()
    """Connected again."""


class Identification:
    """Finds a link's autopilot by its heartbeats.

    Args:
        own: our MAVLink address; an autopilot of another system is accepted after it has been alone for some seconds.
        report: called with events.
    """

    def __init__(self, own: Address, report: EventReport) -> None:
        self.peers: Final = MavlinkPeers(own, expires_after_s=2.5)
        """Service that receives heartbeats; driven by its owner."""
        self.target: Address | None = None
        """The autopilot; None while there is none."""
        self.style: AutopilotStyle = Px4()
        self._own, self._report = own, report
        self._kind = (-1, -1)
        """MAV_AUTOPILOT and MAV_TYPE by which its style was chosen."""
        self._unknown_sources: set[Address] = set()

    @property
    def heartbeat(self) -> MavlinkMessage | None:
        """The last heartbeat of the autopilot."""
        return None if self.target is None or self.target not in self.peers else self.peers[self.target].heartbeat

    @property
    def is_alive(self) -> bool:
        """Whether the autopilot is connected."""
        return self.target is not None and self.target in self.peers and self.peers[self.target].is_alive

    def contact(self) -> Iterator[IdentityChange]:
        """Changes of the contact with the autopilot since this was called last."""
        for change in self.peers.events():
            if change.peer.address != self.target:
                continue
            if change.change is PeerChange.RESTARTED:
                yield IdentityChange.RESTARTED
                continue
            is_back = change.change is PeerChange.RETURNED
            severity = Severity.NOTICE if is_back else Severity.WARNING
            self._report(severity, f"the autopilot has {change.change}", cause=Cause.AUTOPILOT)
            if is_back:
                yield IdentityChange.RETURNED

    def identify(self, now_s: float) -> Iterator[IdentityChange]:
        """Checks the autopilot's identity, and looks for one if there is none."""
        heartbeat = self.heartbeat
        if heartbeat is not None and (heartbeat.autopilot, heartbeat.type) != self._kind:
            yield from self._check_again(heartbeat)
        if self.target is None and self._adopt(now_s):
            yield IdentityChange.FOUND

    def _check_again(self, heartbeat: MavlinkMessage) -> Iterator[IdentityChange]:
        """Another firmware may have been loaded."""
        self._kind = (heartbeat.autopilot, heartbeat.type)
        style = style_of(heartbeat)
        if style is None:
            self._report(Severity.ERROR, f"the autopilot is now {NOT_SUPPORTED}: it is ignored")
            self.target = None
            yield IdentityChange.UNSUPPORTED
        elif (style.style, style.class_properties.vehicle) != (self.style.style, self.style.class_properties.vehicle):
            self._report(Severity.WARNING, f"the autopilot is now {style.style} on a {style.class_properties.vehicle}")
            self.style = style
            yield IdentityChange.REPLACED

    def _adopt(self, now_s: float) -> bool:
        """Takes the one autopilot of our own system, or one that has been alone for some seconds."""
        own_system = [peer for peer in self.peers.autopilots if peer.address.system == self._own.system]
        known = [peer for peer in own_system if style_of(peer.heartbeat) is not None]
        peer = known[0] if len(known) == 1 else self.peers.autopilot(now_s)
        if peer is None or peer.address in self._unknown_sources:
            return False
        heartbeat = peer.heartbeat
        style, name = style_of(heartbeat), f"{peer.address.system}/{peer.address.component}"
        if style is None:
            self._unknown_sources.add(peer.address)
            number = f"MAV_AUTOPILOT {heartbeat.autopilot}, MAV_TYPE {heartbeat.type}"
            self._report(Severity.ERROR, f"{name} is {NOT_SUPPORTED} ({number}): it is ignored")
            return False
        self.target, self.style, self._kind = peer.address, style, (heartbeat.autopilot, heartbeat.type)
        self._report(Severity.INFO, f"{style.style} autopilot found as {name}, on a {style.class_properties.vehicle}")
        return True
