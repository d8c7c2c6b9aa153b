"""Texts of the missions that vehicles have loaded: the station's own copy, or requested from the vehicle once."""

from typing import Final

from gloc3.messages.command_interface import Outcome, ReadMission
from gloc3.mission.model.model import digest_of
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.station.station import Station

REQUESTED_AGAIN_S: Final = 10.0
"""A text that did not come is asked for again after so long."""
KEPT: Final = 32


class MissionTexts:
    """Texts by the digest that vehicles tell of what they have loaded."""

    def __init__(self, station: Station) -> None:
        self._station = station
        self._texts: dict[str, str] = {}
        self._requested_s: dict[str, float] = {}

    def text_of(self, platform: PlatformSnapshot | None, plan: CheckedPlan | None) -> tuple[str, bool]:
        """The mission of a vehicle, and whether it is loaded there.

        Returns:
            The loaded one; while there is none, or its text is not known yet, the one at hand. Empty without either.
        """
        digest = _digest(platform)
        if digest and digest not in self._texts and plan is not None and digest_of(plan.text) == digest:
            self._keep(digest, plan.text)
        if digest in self._texts:
            return self._texts[digest], True
        return ("", False) if plan is None or digest else (plan.text, False)

    def missing(self, platform: PlatformSnapshot | None, now_s: float) -> bool:
        """Whether the text of what a vehicle has loaded should be asked for now."""
        digest = _digest(platform)
        return bool(digest) and digest not in self._texts and now_s >= self._requested_s.get(digest, 0.0)

    async def fetch(self, platform: PlatformSnapshot) -> None:
        """Asks a vehicle for the text of what it has loaded; without an answer it is asked again later."""
        digest, now_s = _digest(platform), self._station.now_s()
        self._requested_s[digest] = now_s + REQUESTED_AGAIN_S
        reply = await self._station.client.request(platform.name, ReadMission())
        if reply.outcome is Outcome.ACCEPTED and digest_of(reply.text) == digest:
            self._keep(digest, reply.text)

    def _keep(self, digest: str, text: str) -> None:
        if len(self._texts) >= KEPT:
            del self._texts[next(iter(self._texts))]
        self._texts[digest] = text


def _digest(platform: PlatformSnapshot | None) -> str:
    return platform.mission.value.digest if platform is not None and platform.mission is not None else ""
