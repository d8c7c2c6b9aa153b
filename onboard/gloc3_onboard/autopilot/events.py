"""PX4's events in its own sentences: reasons against arming, and alerts, by the vehicle's own dictionary.

MAVLink, "Events Interface": a number and packed arguments come as EVENT; `all_events.json.xz` on the vehicle has the
texts. A report on health and arming is a run of events from the arming summary to the health summary.
"""

import lzma
import re
import struct
from collections.abc import Mapping
from typing import Final, NamedTuple

import msgspec

from gloc3.errors import UNREADABLE, Refused
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.services.files.ftp import FtpError
from gloc3.mavlink.services.files.ftp_client import FtpCall, FtpClient

DICTIONARY: Final = "/etc/extras/all_events.json.xz"
LARGEST_BYTES: Final = 8 << 20
"""Of the dictionary when it is unpacked; PX4's has 0.2 MB."""
AGAIN_S: Final = 60.0
"""After this time a dictionary that could not be read is read again."""
ERROR, WARNING = 3, 4
"""MAV_SEVERITY of the least check that keeps from arming, and of the least alert; smaller is worse."""
REPORT_GROUPS: Final = ("arming_check", "health")

_INTEGERS: Final = {"int8_t": "b", "int16_t": "h", "int32_t": "i", "int64_t": "q"}
_CODES: Final = {"float": "f", **_INTEGERS, **{f"u{name}": code.upper() for name, code in _INTEGERS.items()}}
_ARGUMENT: Final = re.compile(r"\{(\d+)(?::\.(\d+))?([^}]*)\}")
_UNITS: Final = {"m": " m", "m_v": " m", "m/s": " m/s", "m^2": " m²", "C": " °C"}
_FOR_DEVELOPERS: Final = re.compile(r"<profile[^>]*>.*?</profile>", re.DOTALL)
_TAG: Final = re.compile(r"<[^>]*>")


class _Argument(msgspec.Struct):
    name: str
    type: str


class _Event(msgspec.Struct):
    name: str
    message: str
    description: str = ""
    arguments: list[_Argument] = []


class _Entry(msgspec.Struct):
    name: str
    description: str = ""


class _Enum(msgspec.Struct):
    type: str
    entries: dict[str, _Entry] = {}


class _Group(msgspec.Struct):
    events: dict[str, _Event] = {}


class _ModeGroups(msgspec.Struct):
    groups: dict[str, list[int]] = {}


class _Component(msgspec.Struct):
    enums: dict[str, _Enum] = {}
    event_groups: dict[str, _Group] = {}
    navigation_mode_groups: _ModeGroups = msgspec.field(default_factory=_ModeGroups)


class _File(msgspec.Struct):
    version: int
    components: dict[str, _Component]


class DescribedEvent(NamedTuple):
    """An event in words."""

    name: str
    group: str
    text: str
    modes: int
    """Of a check: the groups of flight modes that it keeps from being flown, as bits."""


def _group(text: str) -> int:
    """Number of a group of flight modes.

    Raises:
        ValueError: it is none: a bit mask of 64 bits holds them.
    """
    if len(text) > 2 or not 0 <= int(text) < 64:
        raise ValueError(f"there is no group {text[:20]!r} of flight modes")
    return int(text)


class EventDictionary:
    """The texts of events by their numbers.

    Args:
        data: the file, packed with xz.

    Raises:
        ValueError: it cannot be unpacked, or is no dictionary of events.
    """

    def __init__(self, data: bytes) -> None:
        try:
            unpacked = lzma.LZMADecompressor(memlimit=256_000_000).decompress(data, LARGEST_BYTES)
            file = msgspec.json.decode(unpacked, type=_File)
            self._events: Final = {
                (int(component) << 24 | int(number)): (group, event)
                for component, kept in file.components.items()
                for group, events in kept.event_groups.items()
                for number, event in events.events.items()
            }
            self._mode_bits: Final[Mapping[int, int]] = {
                mode: 1 << _group(group)
                for kept in file.components.values()
                for group, modes in kept.navigation_mode_groups.groups.items()
                for mode in modes
            }
        except (lzma.LZMAError, *UNREADABLE) as error:
            raise ValueError(str(error)) from error
        self._enums: Final = {name: one for kept in file.components.values() for name, one in kept.enums.items()}

    def mode_bit(self, custom_mode: int) -> int:
        """The bit of a flight mode's group; all bits for a mode that is not listed."""
        return self._mode_bits.get(custom_mode, -1)

    def describe(self, number: int, arguments: bytes) -> DescribedEvent | None:
        """An event in words; None for one that is not listed, or does not carry the arguments that it should."""
        group, event = self._events.get(number, ("", None))
        if event is None:
            return None
        enums = [self._enums.get(one.type.rpartition("::")[2]) for one in event.arguments]
        types = [one.type if kind is None else kind.type for one, kind in zip(event.arguments, enums, strict=True)]
        try:
            values = struct.unpack_from("<" + "".join(_CODES[name] for name in types), arguments)
        except (struct.error, KeyError):
            return None
        words = [
            kind.entries[str(value)].description or kind.entries[str(value)].name
            if kind is not None and str(value) in kind.entries
            else value
            for kind, value in zip(enums, values, strict=True)
        ]
        sentences = [_plain(_filled(text, words)) for text in (event.message, event.description)]
        modes = next((value for one, value in zip(event.arguments, values, strict=True) if one.name == "modes"), 0)
        return DescribedEvent(event.name, group, ". ".join(text.rstrip(".") for text in sentences if text), modes)


def _filled(text: str, values: list[str | float]) -> str:
    def value(match: re.Match[str]) -> str:
        place, digits, unit = int(match[1]) - 1, match[2], match[3]
        if not 0 <= place < len(values):
            return match[0]
        one = values[place]
        shown = f"{one:.{int(digits)}f}" if digits and not isinstance(one, str) else f"{one}"
        return shown + _UNITS.get(unit, unit)

    return _ARGUMENT.sub(value, text)


def _plain(text: str) -> str:
    """The first paragraph without tags and developer notes."""
    return " ".join(_TAG.sub("", _FOR_DEVELOPERS.sub("", text)).strip().partition("\n\n")[0].split())


class AutopilotEvents:
    """Reads the dictionary once, and translates events from then on.

    Args:
        own: MAVLink address of the reader.
    """

    def __init__(self, own: Address) -> None:
        self.ftp: Final = FtpClient(own)
        """Driven by its owner."""
        self.alerts: list[tuple[int, str]] = []
        """MAV_SEVERITY and text of events since this was last emptied."""
        self.reasons: list[str] | None = None
        """Why it would not arm in the present mode, by the last whole report; None before one has come."""
        self.problem = ""
        """Why there is no dictionary."""
        self.is_problem_reported = False
        """Set by the reader of problems."""
        self._dictionary: EventDictionary | None = None
        self._reading: FtpCall | None = None
        self._next_s = float("-inf")
        self._report: list[str] | None = None

    @property
    def is_readable(self) -> bool:
        """Whether events can be put into words: the dictionary is here."""
        return self._dictionary is not None

    def restart(self) -> None:
        """The autopilot is another one, or has restarted, maybe with another firmware."""
        self._dictionary = self._report = self.reasons = None
        self.problem, self.is_problem_reported = "", False
        self._next_s = float("-inf")

    def tick(self, target: Address, now_s: float, *, is_wanted: bool) -> None:
        """Reads the dictionary where it is wanted and not here."""
        for call in self.ftp.events():
            if call is self._reading:
                self._reading = None
                self._read(call)
        if is_wanted and self._dictionary is None and self._reading is None and now_s >= self._next_s:
            self._next_s = now_s + AGAIN_S
            try:
                self._reading = self.ftp.read(target, DICTIONARY, now_s=now_s)
            except Refused as refusal:
                self.problem = str(refusal)

    def _read(self, call: FtpCall) -> None:
        if call.result is not FtpError.NONE:
            self.problem = f"{DICTIONARY} cannot be read ({call.result.name if call.result else 'no answer'})"
            return
        try:
            self._dictionary = EventDictionary(bytes(call.data))
        except ValueError as error:
            self.problem = f"{DICTIONARY}: {error}"

    def receive(self, message: MavlinkMessage, custom_mode: int) -> None:
        """Takes an EVENT in.

        Args:
            message: it.
            custom_mode: of the last heartbeat; a check that keeps only others from being flown is no reason.
        """
        dictionary = self._dictionary
        event = None if dictionary is None else dictionary.describe(message.id_, bytes(message.arguments))
        if dictionary is None or event is None:
            return
        severity = message.log_levels & 0x0F
        if event.name.endswith("arming_check_summary"):
            self._report = []
        elif event.name.endswith("health_summary"):
            self.reasons, self._report = self._report, None
        elif event.group in REPORT_GROUPS:
            is_reason = severity <= ERROR and event.modes & dictionary.mode_bit(custom_mode)
            if self._report is not None and is_reason:
                self._report.append(event.text)
        elif severity <= WARNING:
            self.alerts.append((severity, event.text))
