"""The end of the process in flight, by the platform's policy: a landing first, or the autopilot's hold."""

import asyncio
from collections.abc import Callable
from typing import Final

from gloc3.exchange import Publisher
from gloc3.exchange.base import Exchange
from gloc3.messages.command_interface import CiReply, CiRequest, Emergency, EmergencyVerb, Outcome
from gloc3.messages.envelope import Envelope, Severity
from gloc3.messages.summaries import MissionSummary, VehicleSummary
from gloc3.messages.vehicle import LandedState
from gloc3.mission.model.states import ActionState
from gloc3.network.rights import ITSELF
from gloc3.platform.platform import Platform

LAND: Final = "land"
SENDER: Final = "service"
"""Sender name of the process in requests to its own command interface."""
POLL_PERIOD_S: Final = 0.2
SILENT_S: Final = 2.0
"""Time without status after which a vehicle is not waited for, s."""
EXTEND_S: Final = 10.0
"""Extension requested repeatedly from the service manager, which ends silent services, s."""
LONGEST_S: Final = 300.0
"""A landing that takes longer is left to the autopilot too."""
DISARMS_S: Final = 10.0
"""Time allowed for the autopilot to disarm after a landing, s."""


class Departure:
    """Monitors whether the vehicle flies, and lands it before the process leaves.

    Args:
        exchange: of the process.
        platform: its file says what is to be done.
        loop: of the process.
        boot: a random number for this start of the process.
        extend: asks the service manager for more seconds.
        report: takes what a person should know.
    """

    def __init__(
        self,
        exchange: Exchange,
        platform: Platform,
        loop: asyncio.AbstractEventLoop,
        boot: int,
        extend: Callable[[float], None],
        report: Callable[[Severity, str], None],
    ) -> None:
        self._platform, self._loop, self._boot, self._extend, self._report = platform, loop, boot, extend, report
        self._topic = f"{platform.platform}/ci/"
        self._publisher = Publisher(exchange, platform.platform, SENDER, boot)
        self._vehicle: VehicleSummary | None = None
        self._received_s = float("-inf")
        self._is_on_mission = False
        self._refusal = ""
        self._unsubscribes = [
            exchange.subscribe(f"{self._topic}vehicle", self._receive_vehicle),
            exchange.subscribe(f"{self._topic}mission", self._follow),
            exchange.subscribe(f"{self._topic}reply", self._receive_reply),
        ]

    @property
    def is_at_rest(self) -> bool:
        """Whether it is known that the vehicle is not armed and no mission runs."""
        vehicle = self._vehicle
        return vehicle is not None and not (vehicle.is_armed or self._is_silent or self._is_on_mission)

    async def land(self, give_up: asyncio.Event) -> None:
        """Lands where that is the policy and the vehicle flies by us; what then still flies is left to the autopilot.

        Args:
            give_up: set when a person does not want to wait.
        """
        if self._platform.on_stop != LAND or not self._is_flying or self._why_not():
            return
        request = CiRequest(
            sender=SENDER,
            boot=self._boot,
            sequence=0,
            body=Emergency(verb=EmergencyVerb.LAND, author="service manager"),
            member=ITSELF,
        )
        self._publisher.publish(f"{self._topic}request", request, self._loop.time())
        self._report(Severity.NOTICE, "the vehicle lands first; a second stop signal leaves it to its autopilot")
        end_s, down_s = self._loop.time() + LONGEST_S, self._loop.time()
        while not (reason := self._why_not()):
            now_s = self._loop.time()
            down_s = now_s if self._is_flying else down_s
            if give_up.is_set() or now_s > end_s or now_s - down_s > DISARMS_S:
                reason = "a second stop signal" if give_up.is_set() else f"it has not landed within {LONGEST_S:g} s"
                break
            self._extend(EXTEND_S)
            await asyncio.sleep(POLL_PERIOD_S)
        if self._is_flying:
            self._report(Severity.WARNING, f"leaves the vehicle in the air: {reason}")

    def close(self) -> None:
        """Listens no more."""
        for unsubscribe in self._unsubscribes:
            unsubscribe()
        self._unsubscribes.clear()

    def _receive_vehicle(self, envelope: Envelope[VehicleSummary]) -> None:
        self._vehicle, self._received_s = envelope.payload, self._loop.time()

    def _follow(self, envelope: Envelope[MissionSummary]) -> None:
        self._is_on_mission = envelope.payload.state == ActionState.RUNNING

    def _receive_reply(self, envelope: Envelope[CiReply]) -> None:
        reply = envelope.payload
        if (reply.sender, reply.boot) == (SENDER, self._boot) and reply.outcome is not Outcome.ACCEPTED:
            self._refusal = reply.reason or str(reply.outcome)

    @property
    def _is_silent(self) -> bool:
        return self._loop.time() - self._received_s > SILENT_S

    @property
    def _is_flying(self) -> bool:
        vehicle = self._vehicle
        return vehicle is not None and vehicle.is_armed and vehicle.landed != LandedState.ON_GROUND

    def _why_not(self) -> str:
        """Why nothing is to be landed, or waited for."""
        vehicle = self._vehicle
        if vehicle is None or self._is_silent:
            return "its state is not known"
        if not vehicle.is_armed:
            return "it is disarmed"
        return "a pilot has control" if vehicle.has_pilot_control else self._refusal
