"""The summary of a region: what a router says of the vehicles that connect to it, once a second."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from functools import partial
from typing import Any, Final

from gloc3.exchange.base import Exchange, Publisher
from gloc3.messages.envelope import Envelope, Message
from gloc3.messages.summaries import (
    ControlState,
    MissionSummary,
    RegionSummary,
    Summary,
    VehicleLine,
    VehicleSummary,
)

REGION_S: Final = 1.0
"""Period of the summaries, s."""
SUBSCRIBED: Final = ("ci/summary", "ci/vehicle", "ci/mission", "ci/control")
"""What a router reads of the vehicles that connect to it."""


def topic_of(router: str) -> str:
    """Where a router says how its vehicles are."""
    return f"regions/{router}/health"


class RegionReporter:
    """Sums up the vehicles of a region.

    Only these are subscribed to, by name, so that nothing comes down from other regions for it.

    Args:
        exchange: the router's.
        loop: its time.
        router: the router's name.
        platforms: that connect to it.
        boot: a random number for this start.
    """

    def __init__(
        self, exchange: Exchange, loop: asyncio.AbstractEventLoop, router: str, platforms: Iterable[str], boot: int
    ) -> None:
        self._loop, self._topic = loop, topic_of(router)
        self._publisher = Publisher(exchange, "regions", router, boot)
        self._known: dict[str, dict[type[Message], Message]] = {name: {} for name in platforms}
        self._received_s: dict[str, float] = {}
        self._undo = [
            exchange.subscribe(f"{name}/{topic}", partial(self._receive, name))
            for name in self._known
            for topic in SUBSCRIBED
        ]
        self._timer = loop.call_later(REGION_S, self._report)

    def close(self) -> None:
        """Says no more."""
        self._timer.cancel()
        for undo in self._undo:
            undo()

    def _receive(self, platform: str, envelope: Envelope[Any]) -> None:
        self._known[platform][type(envelope.payload)] = envelope.payload
        self._received_s[platform] = self._loop.time()

    def _report(self) -> None:
        self._timer = self._loop.call_later(REGION_S, self._report)
        lines = [self._line(name) for name in self._known]
        if lines:
            self._publisher.publish(self._topic, RegionSummary(vehicles=lines), self._loop.time())

    def _line(self, name: str) -> VehicleLine:
        known, received_s = self._known[name], self._received_s.get(name)
        if received_s is None:
            return VehicleLine(name, -1.0)
        health, vehicle, mission, control = (
            known.get(kind) for kind in (Summary, VehicleSummary, MissionSummary, ControlState)
        )
        fields: dict[str, Any] = {}
        if isinstance(health, Summary):
            fields["health"] = health.health.value
        if isinstance(vehicle, VehicleSummary):
            fields |= {"mode": vehicle.mode, "is_armed": vehicle.is_armed, "landed": vehicle.landed}
            fields["battery_percent"] = vehicle.battery_percent
        if isinstance(mission, MissionSummary):
            fields |= {"mission": mission.name, "mission_state": mission.state}
        if isinstance(control, ControlState):
            fields["holder"] = control.holder
        return VehicleLine(name, round(self._loop.time() - received_s, 1), **fields)
