"""The station's configuration file: theme, links and last session; TOML, kept as written.

What a person wrote stays: comments, order and unknown forms of a value. A file that cannot be read, or holds something
that is wrong, is reported with its place and never written to.
"""

import os
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Literal

import msgspec
import tomlkit
from tomlkit.exceptions import TOMLKitError

from gloc3.errors import Finding, InputError, Refused, nearest
from gloc3.store import replace_file
from gloc3_groundstation.announcing.announcements import AlertLevel
from gloc3_groundstation.corrections.source_url import parse_source
from gloc3_groundstation.joysticks.mapping import JoystickMapping

ThemeName = Literal["dark", "daylight", "mono"]
DEFAULT_LINK: Final = "udpin://127.0.0.1:14550"
RECENT_KEPT: Final = 10


class LastSession(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """State of the last session; written by the station when it closes."""

    platform: str = ""
    """The selected vehicle; empty for the first one in contact."""
    screen: str = "overview"
    missions: tuple[str, ...] = ()
    """Mission files that were opened, the last one first."""


class Configuration(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Contents of the configuration file."""

    theme: ThemeName = "dark"
    station_id: int = 255
    """The MAVLink system of this station, 200 to 255."""
    links: tuple[str, ...] = (DEFAULT_LINK,)
    signing_key: str = ""
    """A file with the key that signs all links; empty for links that are not signed."""
    forward: tuple[str, ...] = ()
    """Links to other stations, to which the vehicles' frames are forwarded, one way."""
    forward_both: tuple[str, ...] = ()
    """The same, and frames from there pass to the vehicles."""
    rtk: str = ""
    """Source of RTK corrections, such as `ntrip://USER:PASSWORD@HOST:2101/MOUNTPOINT`; empty for none."""
    downloads: str = ""
    """Folder for downloads from vehicles; empty for the one in which the station was started."""
    terrain: str = ""
    """Folder of terrain tiles (SRTM .hgt or .hgt.zip); empty for none."""
    bell: AlertLevel = "off"
    """Alerts that ring the terminal's bell: those of this severity and worse."""
    speech: AlertLevel = "off"
    """Alerts that are spoken."""
    gamepad: str = ""
    """The device of a joystick for steering by hand, such as `/dev/input/js0`; empty for every joystick."""
    joysticks: Mapping[str, JoystickMapping] = {}
    """Mappings of joysticks, by the key of the device; written by the mapping dialogue."""
    session: LastSession = LastSession()

    def with_mission(self, file: str) -> "Configuration":
        """The same with a mission file as the one opened last."""
        missions = with_recent(self.session.missions, file)
        return msgspec.structs.replace(self, session=msgspec.structs.replace(self.session, missions=missions))


def with_recent(missions: tuple[str, ...], file: str) -> tuple[str, ...]:
    """Mission files, the last one first, with one that has just been opened."""
    return (file, *(mission for mission in missions if mission != file))[:RECENT_KEPT]


class ConfigurationFile:
    """One file, read once and written when the station closes."""

    def __init__(self, path: Path) -> None:
        self.path: Final = path
        self._read: Configuration | None = None
        """What the file held; None while it must not be written."""

    def read(self) -> Configuration:
        """What the file holds; the defaults where there is none.

        Raises:
            InputError: it cannot be used; it will not be written to.
        """
        self._read = None
        self._read, _ = self._load()
        return self._read

    def write(self, configuration: Configuration) -> bool:
        """Writes only the values that have changed since it was read.

        Returns:
            Whether the file is up to date; false where it could not be read or written.
        """
        before = self._read
        if before is None:
            return False
        if configuration == before:
            return True
        try:
            _, text = self._load()
            document = tomlkit.parse(text)
            _merge(document, msgspec.to_builtins(before), msgspec.to_builtins(configuration))
            self.path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(self.path, tomlkit.dumps(document).encode())
        except (InputError, OSError, TOMLKitError):
            return False
        self._read = configuration
        return True

    def _load(self) -> tuple[Configuration, str]:
        name = str(self.path)
        try:
            text = self.path.read_text(encoding="utf-8")
        except FileNotFoundError:
            return Configuration(), ""
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "it is no UTF-8 text"
            raise InputError([Finding(file=name, message=f"cannot be read: {reason}")]) from None
        try:
            data = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            message, _, place = str(error).rpartition(" (at ")
            found = re.fullmatch(r"line (\d+), column (\d+)\)", place)
            line, column = (int(found[1]), int(found[2])) if found else (len(text.splitlines()), 1)
            raise InputError([Finding(file=name, line=line, column=column, message=message)]) from None
        return _checked(data, text, name), text


def default_path(environment: Mapping[str, str] = os.environ) -> Path:
    """`gloc3/station.toml` in the XDG configuration directory."""
    base = environment.get("XDG_CONFIG_HOME", "")
    folder = Path(base) if base.startswith("/") else Path(environment.get("HOME", "~")).expanduser() / ".config"
    return folder / "gloc3" / "station.toml"


def unsaved_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """Where changes of missions are put that were not saved when the station closed: the XDG folder of states."""
    base = environment.get("XDG_STATE_HOME", "")
    home = Path(environment.get("HOME", "~")).expanduser()
    return (Path(base) if base.startswith("/") else home / ".local" / "state") / "gloc3" / "unsaved"


def _checked(data: dict[str, Any], text: str, file: str) -> Configuration:
    """Values with checked types; errors for unknown names suggest the nearest known one."""
    findings = []
    for table, known in (("", Configuration), ("session", LastSession)):
        values = data if not table else data.get(table, {})
        fields = known.__struct_fields__
        for name in values if isinstance(values, dict) else ():
            if name not in fields:
                line, column = _place(text, table, name)
                message, hint = f"unknown setting {name!r}", nearest(name, fields)
                findings.append(Finding(file=file, line=line, column=column, message=message, hint=hint))
    if findings:
        raise InputError(findings)
    try:
        configuration = msgspec.convert(data, Configuration)
    except msgspec.ValidationError as error:
        message, _, path = str(error).partition(" - at `$.")
        *tables, name = re.sub(r"\[.*?\]", "", path.rstrip("`")).split(".")
        line, column = _place(text, tables[0] if tables else "", name)
        raise InputError([Finding(file=file, line=line, column=column, message=f"{name}: {message}")]) from None
    if not 200 <= configuration.station_id <= 255:
        line, column = _place(text, "", "station_id")
        finding = Finding(file=file, line=line, column=column, message="station_id: must be from 200 to 255")
        raise InputError([finding])
    try:
        if configuration.rtk:
            parse_source(configuration.rtk)
    except Refused as refusal:
        line, column = _place(text, "", "rtk")
        raise InputError([Finding(file=file, line=line, column=column, message=f"rtk: {refusal}")]) from None
    return configuration


def _place(text: str, table: str, name: str) -> tuple[int, int]:
    """Line and column, from 1, where a name of a table is set; 0 and 0 where that is not to be found."""
    here = ""
    for number, line in enumerate(text.splitlines(), start=1):
        header = re.match(r"\s*\[\s*([^\[\]]+?)\s*\]", line)
        if header:
            here = header.group(1).strip("\"'")
            if not table and here == name:
                return number, line.index(here) + 1
        found = re.match(rf"""(\s*)["']?(?:{re.escape(table)}\.)?{re.escape(name)}["']?\s*[=.]""", line)
        if found and (here in (table, "") or (table and here.startswith(f"{table}."))):
            return number, len(found.group(1)) + 1
    return 0, 0


def _merge(document: Any, before: dict[str, Any], after: dict[str, Any]) -> None:
    """Sets in a document what differs between two configurations."""
    for name, value in after.items():
        if isinstance(value, dict):
            if value != before.get(name):
                if name not in document:
                    document[name] = tomlkit.table()
                _merge(document[name], before.get(name, {}), value)
        elif value != before.get(name):
            document[name] = list(value) if isinstance(value, tuple) else value
    for name in before.keys() - after.keys():
        document.pop(name, None)
