"""The station's half of teleoperation: sends demands at 10 Hz while the dead-man's key is held."""

import asyncio
from abc import ABC, abstractmethod
from typing import Final, NamedTuple

from gloc3.messages.teleoperation import DEMAND_HZ, VelocityDemand
from gloc3_groundstation.joysticks.device import StickDemand
from gloc3_groundstation.station.command_client import CommandClient

RELEASES: Final = 3
"""Number of times that the release of the key is sent; if all are lost, the last demand expires onboard."""


class FullSpeed(NamedTuple):
    """Speeds of a stick at its end; the vehicle keeps to its own limits besides."""

    across_m_s: float = 0.5
    up_m_s: float = 0.3
    turn_deg_s: float = 20.0


class Hand(ABC):
    """The operator's hand on the sticks: what it demands is sent while the dead-man's key is held.

    Args:
        loop: the event loop, for time and timers.
        rate_hz: how often the demand is sent.
        rests: whether the centred sticks are sent on after the key was released, until the hand is closed.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, rate_hz: float, *, rests: bool = False) -> None:
        self._loop, self._period_s, self._rests = loop, 1.0 / rate_hz, rests
        self._sticks = StickDemand()
        self._kept_until_s = float("-inf")
        self._releases = 0
        self._timer: asyncio.TimerHandle | None = None

    @property
    def sticks(self) -> StickDemand:
        """Stick positions."""
        return self._sticks

    @property
    def is_kept(self) -> bool:
        """Whether the dead-man's key is kept: demands go out."""
        return self._loop.time() < self._kept_until_s

    def move(self, sticks: StickDemand) -> None:
        """Moves the sticks; nothing goes out for that alone."""
        self._sticks = StickDemand(*(min(max(part, -1.0), 1.0) for part in sticks))

    def hold_key(self, for_s: float) -> None:
        """Registers that the dead-man's key is held; it counts as held for `for_s`."""
        was_kept, self._kept_until_s = self.is_kept, self._loop.time() + for_s
        self._releases = RELEASES
        if not was_kept:
            self._cancel()
            self._tick()

    def release(self) -> None:
        """The key was let go: the vehicle shall rest."""
        if self.is_kept:
            self._kept_until_s = float("-inf")
            self._cancel()
            self._tick()

    def rest(self) -> None:
        """Sends the centred sticks from now on, before the key is held for the first time."""
        self._releases = RELEASES
        if self._timer is None:
            self._tick()

    def silence(self) -> None:
        """Sends nothing any more, not even the release: somebody else commands the vehicle."""
        self._kept_until_s = float("-inf")
        self._releases = 0
        self._cancel()

    def close(self) -> None:
        """Releases control, and repeats the release if it has not been sent often enough."""
        self._kept_until_s = float("-inf")
        self._cancel()
        if self._releases:
            self._releases = 0
            self._send(StickDemand())

    @abstractmethod
    def _send(self, sticks: StickDemand) -> None:
        """Sends a demand."""

    def _cancel(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _tick(self) -> None:
        """Sends the current demand, and runs again while there is something to send."""
        self._timer = None
        if self.is_kept:
            self._send(self._sticks)
        elif self._releases:
            self._releases -= not self._rests
            self._send(StickDemand())
        else:
            return
        self._timer = self._loop.call_later(self._period_s, self._tick)


class HandControl(Hand):
    """One teleoperation session of one platform.

    Args:
        client: sends the demands of the station.
        loop: the event loop, for time and timers.
        platform: name of the controlled one.
        full: speeds at full stick deflection.
    """

    def __init__(
        self,
        client: CommandClient,
        loop: asyncio.AbstractEventLoop,
        platform: str,
        full: FullSpeed = FullSpeed(),  # noqa: B008 - immutable
    ) -> None:
        super().__init__(loop, DEMAND_HZ)
        self.platform: Final = platform
        self.session: Final = client.new_session()
        self.sent = 0
        """Demands so far; the number of the next one."""
        self._client, self._full = client, full

    def _send(self, sticks: StickDemand) -> None:
        full = self._full
        demand = VelocityDemand(
            sender=self._client.station,
            session=self.session,
            sequence=self.sent,
            velocity_cm_s=(
                round(sticks.surge * full.across_m_s * 100.0),
                round(sticks.sway * full.across_m_s * 100.0),
                round(sticks.heave * full.up_m_s * 100.0),
            ),
            yaw_rate_cdeg_s=round(sticks.yaw * full.turn_deg_s * 100.0),
        )
        self.sent += 1
        self._client.demand(self.platform, demand)
