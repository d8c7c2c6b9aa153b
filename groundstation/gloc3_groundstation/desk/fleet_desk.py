"""Control of the vehicles, handed over between stations, and the links that lead to them."""

from collections.abc import Awaitable, Iterable
from typing import Protocol

from gloc3.errors import Gloc3Error, Refused
from gloc3.messages.command_interface import Control, ControlVerb
from gloc3.messages.envelope import Severity
from gloc3.messages.software import own_software
from gloc3_groundstation.corrections.corrections import CorrectionsSwitch, NoCorrections
from gloc3_groundstation.desk import flights
from gloc3_groundstation.links.link_snapshot import LinkSnapshot
from gloc3_groundstation.station.snapshots import Fleet, PlatformSnapshot
from gloc3_groundstation.station.station import Station


class LinkStore(Protocol):
    """Interface to the station's links."""

    def snapshots(self, platforms: Iterable[str]) -> tuple[LinkSnapshot, ...]:
        """All links, with those of these platforms that are behind each."""

    async def add(self, url: str) -> None:
        """Opens one more link; raises `Refused` where that cannot be."""

    async def forward(self, url: str, *, is_both: bool) -> None:
        """Opens a link to another station, one way or both; raises `Refused` where that cannot be."""

    async def remove(self, url: str) -> None:
        """Closes a link; raises `Refused` where there is none of that name."""


class NoLinks:
    """A station without links, as in tests."""

    def snapshots(self, platforms: Iterable[str]) -> tuple[LinkSnapshot, ...]:
        """None."""
        return ()

    async def add(self, url: str) -> None:
        """Refuses."""
        raise Refused(f"{url}: this station opens no links")

    async def forward(self, url: str, *, is_both: bool) -> None:
        """Refuses."""
        raise Refused(f"{url}: this station opens no links")

    async def remove(self, url: str) -> None:
        """Refuses."""
        raise Refused(f"there is no link {url}")


class FleetDesk:
    """Control of a vehicle, and links; refusals become events, never exceptions."""

    def __init__(self, station: Station, links: LinkStore | None = None) -> None:
        """Creates a desk.

        Args:
            station: receives from and commands the platforms.
            links: the station's links.
        """
        self._station = station
        self._links: LinkStore = NoLinks() if links is None else links
        self.corrections: CorrectionsSwitch = NoCorrections()
        """RTK corrections for the vehicles."""
        self._station.listen(self._watch_control)

    def named(self, names: Iterable[str]) -> list[str]:
        """Those of some names that are vehicles of the fleet, in its order."""
        wanted = set(names)
        return [platform.name for platform in self._station.fleet if platform.name in wanted]

    # --- control of one vehicle ---

    def control_verbs(self, platform: PlatformSnapshot) -> frozenset[ControlVerb]:
        """Control requests that are possible for a vehicle now; none for one without a GLOC3 companion."""
        if not platform.has_companion:
            return frozenset()
        state = platform.control.value if platform.control is not None else None
        if state is None or state.holder != self._station.id:
            used = {ControlVerb.TAKE_OVER} if state is not None and state.holder else set()
            return frozenset({ControlVerb.REQUEST, *used})
        requested = {ControlVerb.GRANT, ControlVerb.REFUSE} if state.requested_by else set()
        return frozenset({ControlVerb.RELEASE, *requested})

    async def control(self, name: str, verb: ControlVerb) -> bool:
        """Requests, takes over, releases, grants or refuses control of a vehicle."""
        if verb is ControlVerb.REQUEST:
            return await self._do(name, "control", flights.request_control(self._station, name))
        platform = self._station.fleet.get(name)
        requester = platform.control.value.requested_by if platform is not None and platform.control is not None else ""

        async def request() -> None:
            if verb is ControlVerb.TAKE_OVER:
                await flights.take_over(self._station, name)
                return
            station = requester if verb in (ControlVerb.GRANT, ControlVerb.REFUSE) else ""
            reply = await self._station.client.carry_out(
                name, Control(verb=verb, station=station, **own_software()._asdict())
            )
            self._station.note(name, Severity.INFO, f"control: {reply.reason or verb}")

        return await self._do(name, f"control: {verb.replace('_', ' ')}", request())

    def _watch_control(self, before: Fleet, after: Fleet, now_s: float) -> None:
        """Reports when another station requests this station's control, and when control has moved."""
        own = self._station.id
        for was, platform in after.changed_since(before):
            if platform.control is None:
                continue
            state, previous = platform.control.value, was.control.value if was is not None and was.control else None
            if (
                state.holder == own
                and state.requested_by
                and (previous is None or previous.requested_by != state.requested_by)
            ):
                requester = f"station {state.requested_by} requests control; grant or refuse it on the screen Fleet"
                self._station.note(platform.name, Severity.WARNING, requester)
            elif previous is not None and previous.holder == own and state.holder != own:
                whose = f"station {state.holder} has control now" if state.holder else "no station has control now"
                self._station.note(platform.name, Severity.WARNING, whose)

    # --- links ---

    def links(self) -> tuple[LinkSnapshot, ...]:
        """All links as they are now."""
        return self._links.snapshots(self._station.fleet.platforms)

    async def add_link(self, url: str) -> bool:
        """Opens one more link."""
        return await self._linked(self._links.add(url), f"link {url} is open")

    async def forward_to(self, url: str, *, is_both: bool) -> bool:
        """Forwards the vehicles' frames to another station, whose commands pass to them if it is both ways."""
        how = "both ways: commands from there pass to the vehicles" if is_both else "one way"
        return await self._linked(self._links.forward(url, is_both=is_both), f"frames are forwarded to {url}, {how}")

    async def remove_link(self, url: str) -> bool:
        """Closes a link; its vehicles are left to their policies."""
        return await self._linked(self._links.remove(url), f"link {url} is closed")

    async def start_corrections(self, url: str) -> bool:
        """Takes RTK corrections from a source."""
        return await self._do("", "RTK corrections", self.corrections.open(url))

    async def stop_corrections(self) -> bool:
        """Takes none any more."""
        return await self._do("", "RTK corrections", self.corrections.stop())

    async def _linked(self, work: Awaitable[None], then: str) -> bool:
        is_done = await self._do("", "link", work)
        if is_done:
            self._station.note("", Severity.INFO, then)
        return is_done

    async def _do(self, name: str, what: str, work: Awaitable[None]) -> bool:
        try:
            await work
        except Gloc3Error as error:
            self._station.note(name, Severity.ERROR, f"{what}: {error}")
            return False
        return True
