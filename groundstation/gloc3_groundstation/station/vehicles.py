"""Identification of vehicles: autopilots received on links, matched with platforms or shown as bare vehicles.

A vehicle is identified by its link and its MAVLink system there, never by the system alone: two vehicles may have the
same one. An autopilot received on several links is still one vehicle.
"""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Final, NamedTuple, Protocol

from msgspec.structs import replace

from gloc3.errors import Refused
from gloc3.exchange.base import Unsubscribe
from gloc3.mavlink.codec import Frame, message, shape
from gloc3.mavlink.flight_modes import autopilot_name, type_name
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.heartbeat import AUTOPILOT_INVALID
from gloc3.mavlink.services.interval import SET_MESSAGE_INTERVAL
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import AUTOPILOT_SAYS
from gloc3_groundstation.links.vehicle_wire import VehicleWire
from gloc3_groundstation.services.machines import Wire
from gloc3_groundstation.services.snapshot import FIRMWARES
from gloc3_groundstation.station import fleet as reducers
from gloc3_groundstation.station.autopilot_watch import BEATS_WITHIN_S, STATE_HZ, AutopilotWatch
from gloc3_groundstation.station.readings import RADIO_STATUS, Reading, radio
from gloc3_groundstation.station.snapshots import AutopilotSnapshot, Fleet, PlatformSnapshot, Timed, VehicleProblem
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.station.wording import duration

POLL_PERIOD_S: Final = 0.5
TIMEOUT_S: Final = 3.0
"""Time after which a vehicle is shown as one without a companion, s; a companion reports sooner."""
EXTRA_TIMEOUT_S: Final = 8.0
"""The same where a companion is received that has not yet reported whether it runs GLOC3."""
REQUEST_COUNT: Final = 4
REQUEST_PERIOD_S: Final = 5.0
MISSED_S: Final = 2.5
"""Age of the last heartbeat from which another route is preferred, s: two have been missed."""
READINGS_AFTER_S: Final = 6.0
"""Time for readings to come unrequested, s."""
MOST_VEHICLES: Final = 64
_COMPANION: Final = 191
_HEARTBEAT, _SYSTEM_TIME = shape("HEARTBEAT").id, shape("SYSTEM_TIME").id
RESTARTED: Final = (
    "its autopilot has restarted, or is another one with its system id: mode and home are reset; "
    "check them and its plan before flight"
)
_IDS_HINT: Final = "give one of them another id (PX4: MAV_SYS_ID, ArduPilot: SYSID_THISMAV or MAV_SYSID)"


class VehicleListener(Wire, Protocol):
    """The part of a link that the vehicles need; `gloc3_groundstation.links.links.Link` is one."""

    def platforms(self) -> list[tuple[str, Address]]:
        """Platforms whose companions are received there, with the companions' addresses."""


SenderKey = tuple[int, int, int]
"""How a vehicle is reached: number of the link from 1, system and component of its autopilot."""


class _Line(NamedTuple):
    """A link that is open."""

    url: str
    link: VehicleListener
    unlisten: Unsubscribe


class Vehicles:
    """Keeps the fleet's autopilots up to date."""

    def __init__(self, station: Station, links: Callable[[], Sequence[tuple[str, VehicleListener]]]) -> None:
        """Begins to listen.

        Args:
            station: owner of the fleet.
            links: returns the URLs and the open links.
        """
        self._station = station
        self._links = links
        self._loop = asyncio.get_running_loop()
        self._lines: dict[int, _Line] = {}
        """By number, in the order in which they were opened."""
        self._opened = 0
        self._watches: dict[SenderKey, AutopilotWatch] = {}
        self._companions: set[tuple[int, int]] = set()
        """Links and systems on which a companion is received."""
        self._platforms: dict[tuple[int, int], str] = {}
        """Links and systems to the platform whose companion is received there."""
        self._names: dict[SenderKey, str] = {}
        """Vehicle on each route."""
        self._wires: dict[SenderKey, VehicleWire] = {}
        """The links to a vehicle as one, by the route on which it was first asked for."""
        self._radios: dict[int, Reading] = {}
        """What the radio of a link said last."""
        self._restarts: dict[SenderKey, float] = {}
        """Times of autopilot restarts that have been reported."""
        self._requested: dict[SenderKey, tuple[int, float]] = {}
        """Number and last time of requests to a vehicle for messages that it does not send by default."""
        self._timer = self._loop.call_later(POLL_PERIOD_S, self._poll)

    def reach(self, name: str) -> tuple[VehicleWire, Address]:
        """The links to a vehicle as one, and the address of its autopilot.

        Raises:
            Refused: no link receives it.
        """
        key = self._route(name)
        if key is None:
            hint = "--link udpin://0.0.0.0:14550 listens where autopilots and telemetry routers send"
            raise Refused(f"no link of this station hears the autopilot of {name}; {hint}")
        wire = next((self._wires[one] for one in self._routes(name) if one in self._wires), None)
        if wire is None:
            wire = self._wires[key] = VehicleWire()
        wire.use(self._links_to(name))
        return wire, Address(key[1], key[2])

    def best_links(self) -> list[tuple[str, VehicleListener]]:
        """URL and link of every PX4 or ArduPilot vehicle that is alive, by its best route; each link once."""
        now_s = self._station.now_s()
        keys = (self._route(name) for name in dict.fromkeys(self._names.values()))
        alive = {
            key[0]
            for key in keys
            if key is not None
            and self._watches[key].autopilot in FIRMWARES
            and now_s - self._watches[key].beat_s < BEATS_WITHIN_S
        }
        return [(self._lines[number].url, self._lines[number].link) for number in sorted(alive)]

    def close(self) -> None:
        """Hears nothing more."""
        self._timer.cancel()
        for wire in self._wires.values():
            wire.use(())
        for line in self._lines.values():
            line.unlisten()

    # --- what is heard ---

    def _receive_frame(self, number: int, frame: Frame) -> None:
        if frame.message_id == RADIO_STATUS:
            self._receive_radio(number, frame)
        key = (number, frame.system, frame.component)
        watch = self._watches.get(key)
        if watch is None:
            if frame.message_id != _HEARTBEAT:
                return
            beat = frame.decode()
            if beat is None or beat.autopilot == AUTOPILOT_INVALID:
                if frame.component == _COMPANION:
                    self._companions.add((number, frame.system))
                return
            if len(self._watches) >= MOST_VEHICLES:
                return
            watch = self._watches[key] = AutopilotWatch(self._station.now_s())
        watch.receive(frame, self._station.now_s())

    def _receive_radio(self, number: int, frame: Frame) -> None:
        """Keeps what the radio of a link says of itself."""
        message = frame.decode()
        said = None if message is None else radio(message, frame.sender)
        if said is not None:
            self._radios[number] = Reading(said[0], self._station.now_s(), said[1])

    # --- what follows from it ---

    def _poll(self) -> None:
        self._timer = self._loop.call_later(POLL_PERIOD_S, self._poll)
        links = self._links()
        for number, line in list(self._lines.items()):
            if not any(link is line.link for _, link in links):
                self._drop_link(number)
        for url, link in links:
            if not any(link is line.link for line in self._lines.values()):
                self._opened += 1
                self._lines[self._opened] = _Line(url, link, link.listen(partial(self._receive_frame, self._opened)))
        for number, line in self._lines.items():
            for name, address in line.link.platforms():
                self._platforms[number, address.system] = name
        self._station.change(self._settled)
        for key, wire in self._wires.items():
            wire.use(self._links_to(self._names[key]) if key in self._names else ())
        for name in dict.fromkeys(self._names.values()):
            known, best = self._station.fleet.get(name), self._route(name)
            if known is not None and best is not None:
                watch, has_companion = self._watches[best], known.has_companion
                if not has_companion or self._station.now_s() - watch.first_s >= READINGS_AFTER_S:
                    self._request_streams(best, watch.missing(has_companion=has_companion))
        for key, watch in self._watches.items():
            if watch.boot_at_s is None and any(one[0] != key[0] and one[1] == key[1] for one in self._watches):
                self._request_streams(
                    key, {_SYSTEM_TIME: STATE_HZ}
                )  # whether it is the same vehicle as on the other link

    def _request_streams(self, key: SenderKey, missing: Mapping[int, float]) -> None:
        """Requests messages that a vehicle does not send by default."""
        now_s, (times, last_s) = self._station.now_s(), self._requested.get(key, (0, float("-inf")))
        restarted_s = self._watches[key].restarted_s(now_s)
        if restarted_s is not None and last_s < restarted_s:  # what was requested is forgotten there
            times = 0
        if not missing or times >= REQUEST_COUNT or now_s < last_s + REQUEST_PERIOD_S:
            return
        self._requested[key] = times + 1, now_s
        link = self._lines[key[0]].link
        for number, rate_hz in missing.items():
            params = {"param1": float(number), "param2": 1e6 / rate_hz}
            link.send(
                message(
                    "COMMAND_LONG",
                    target_system=key[1],
                    target_component=key[2],
                    command=SET_MESSAGE_INTERVAL,
                    **params,
                )
            )

    def _drop_link(self, number: int) -> None:
        """Handles a closed link: vehicles received only there are no longer shown, or lose their autopilot."""
        self._lines.pop(number).unlisten()
        routes = [key for key in self._watches if key[0] == number]
        before = {self._names[key] for key in routes if key in self._names}
        for key in routes:
            del self._watches[key]
            self._names.pop(key, None)
        lost = before - set(self._names.values())

        def without(fleet: Fleet, now_s: float) -> Fleet:
            del now_s
            for name in sorted(lost):
                known = fleet.get(name)
                if known is not None and known.has_companion:
                    fleet = reducers.with_platform(fleet, replace(known, autopilot=None, problems=()))
                else:
                    fleet = reducers.without(fleet, name)
            return fleet

        self._station.change(without)

    def _settled(self, fleet: Fleet, now_s: float) -> Fleet:
        """The fleet with every autopilot where it belongs."""
        for key, watch in self._watches.items():
            name = self._name_for(key, watch, fleet, now_s)
            before = self._names.get(key)
            if name is None or name == before:
                continue
            self._names[key] = name
            if before is not None and before not in self._names.values():
                fleet = reducers.renamed(fleet, before, name, now_s)
        for name in dict.fromkeys(self._names.values()):
            best = self._route(name)
            if best is not None:
                fleet = self._shown(fleet, name, best, now_s)
                fleet = self._with_texts(fleet, name, now_s)
        return fleet

    def _with_texts(self, fleet: Fleet, name: str, now_s: float) -> Fleet:
        """What an autopilot says, as events, unless a companion passes it on; all routes bring the same."""
        texts, *_ = [self._watches[route].new_texts(now_s) for route in self._routes(name)]
        known = fleet.get(name)
        if known is not None and (not known.has_companion or known.is_quiet_link(now_s)):
            for text in texts:
                severity = Severity(min(text.severity, Severity.DEBUG))
                fleet = reducers.note(fleet, name, severity, f"{AUTOPILOT_SAYS}{text.text}", now_s)
        return fleet

    def _name_for(self, key: SenderKey, watch: AutopilotWatch, fleet: Fleet, now_s: float) -> str | None:
        """Which vehicle an autopilot belongs to; None while that is not known."""
        number, system, _ = key
        platform = self._platforms.get((number, system))
        if platform is not None and fleet.get(platform) is not None:
            return platform
        for other, name in self._names.items():
            known = fleet.get(name)
            is_final = key not in self._names or (known is not None and known.has_companion)
            if is_final and other[0] != number and other[1] == system and self._watches[other].is_same_life(watch):
                return name
        if key in self._names:
            return self._names[key]
        is_awaited = (number, system) in self._companions
        if now_s - watch.first_s < (EXTRA_TIMEOUT_S if is_awaited else TIMEOUT_S):
            return None
        firmware = FIRMWARES.get(watch.autopilot)
        base = f"{firmware.lower() if firmware else 'autopilot'}-{system}"
        used = {*self._names.values(), *fleet.platforms}
        name = base if base not in used else f"{base}@{number}"
        return name if name not in used else f"{name}.{key[2]}"

    def _shown(self, fleet: Fleet, name: str, key: SenderKey, now_s: float) -> Fleet:
        """The fleet with the state of one autopilot."""
        number, system, component = key
        watch, known = self._watches[key], fleet.get(name)
        autopilot = AutopilotSnapshot(
            link=self._lines[number].url,
            system=system,
            component=component,
            firmware=autopilot_name(watch.autopilot),
            vehicle_type=type_name(watch.vehicle_type),
            is_alive=now_s - watch.beat_s < BEATS_WITHIN_S,
            restarted_s=watch.restarted_s(now_s),
            fix_type=watch.fix_type,
            has_used_rtk=watch.has_used_rtk,
            readings=self._readings(key),
            flight=watch.flight.words(duration),
            home_geo=watch.readings.home_geo,
        )
        problems = tuple(self._problems(name, key, now_s))
        if known is not None and known.has_companion:
            shown = replace(known, autopilot=autopilot, problems=problems)
            if known.is_quiet_link(now_s) and watch.received_s > known.received_s:
                shown = replace(shown, vehicle=Timed(watch.summary(now_s), watch.reported_s(now_s)))
            return fleet if shown == known else reducers.with_platform(fleet, shown)
        if known is None:
            what = f"{autopilot.firmware} {autopilot.vehicle_type}".rstrip()
            text = f"is heard: {what}, system {system}, without a GLOC3 companion: commanded through its autopilot"
            fleet = reducers.note(fleet, name, Severity.INFO, text, now_s)
        elif known.is_quiet_link(now_s) and watch.received_s > known.received_s:
            silence = duration(watch.received_s - known.received_s)
            fleet = reducers.note(fleet, name, Severity.NOTICE, f"is heard again after {silence} of silence", now_s)
        if autopilot.restarted_s is not None and autopilot.restarted_s != self._restarts.get(key):
            self._restarts[key] = autopilot.restarted_s
            fleet = reducers.note(fleet, name, Severity.WARNING, RESTARTED, now_s)
        platform = PlatformSnapshot(
            name=name,
            boot=0,
            first_received_s=watch.first_s if known is None else known.first_received_s,
            received_s=watch.received_s,
            vehicle=Timed(watch.summary(now_s), watch.reported_s(now_s)),
            motion=Timed(watch.place.motion, watch.place_s) if watch.place.motion is not None else None,
            site=Timed(watch.place.site, watch.place_s) if watch.place.site is not None else None,
            link=watch.link,
            has_companion=False,
            autopilot=autopilot,
            problems=problems,
        )
        return fleet if platform == known else reducers.with_platform(fleet, platform)

    def _readings(self, key: SenderKey) -> dict[str, Reading]:
        """Readings of an autopilot and of the radio that leads to it."""
        radio_reading = self._radios.get(key[0])
        return {**self._watches[key].readings.all, **({} if radio_reading is None else {"radio": radio_reading})}

    def _route(self, name: str) -> SenderKey | None:
        """Best route to a vehicle: one with heartbeats, in the order in which the links were given."""
        return next(iter(self._routes(name)), None)

    def _routes(self, name: str) -> list[SenderKey]:
        """All routes to a vehicle, the best one first."""
        routes = sorted(key for key, owner in self._names.items() if owner == name)
        now_s = self._station.now_s()

        def silence(key: SenderKey) -> int:
            age_s = now_s - self._watches[key].beat_s
            return (age_s >= MISSED_S) + (age_s >= BEATS_WITHIN_S)

        return sorted(routes, key=silence)

    def _links_to(self, name: str) -> list[Wire]:
        """The links that lead to a vehicle, the best one first, each once."""
        return list({number: self._lines[number].link for number, _, _ in self._routes(name)}.values())

    def _problems(self, name: str, key: SenderKey, now_s: float) -> list[VehicleProblem]:
        """What is wrong with one autopilot."""
        found = []
        number, system, _ = key
        watch = self._watches[key]
        if watch.autopilot not in FIRMWARES:
            said = autopilot_name(watch.autopilot)
            text = (
                f"unknown autopilot ({said}), neither PX4 nor ArduPilot: parameters, files and message rates may work,"
                " calibration does not; use its own ground station for the rest"
            )
            found.append(VehicleProblem(what="firmware", severity=Severity.WARNING, text=text))
        if watch.is_doubled(now_s):
            text = f"two vehicles share system id {system} on {self._lines[number].url}: both obey; {_IDS_HINT}"
            found.append(VehicleProblem(what="system id", severity=Severity.ERROR, text=text))
        others = [
            f"{owner} on {self._lines[other[0]].url}"
            for other, owner in self._names.items()
            if owner != name and other[1] == system and now_s - self._watches[other].beat_s < BEATS_WITHIN_S
        ]
        if others:
            text = f"{others[0]} has the same system id {system}: each is addressed on its own link; {_IDS_HINT}"
            found.append(VehicleProblem(what="same system id", severity=Severity.WARNING, text=text))
        return found
