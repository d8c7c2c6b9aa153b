"""A flight as data: what is flown, with which seed, weather and faults. One line of JSON replays it."""

import shlex
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec

from gloc3.errors import UNREADABLE, Refused
from gloc3.messages.frames import GeoPoint
from gloc3_sitl.faults.fault_text import parse


class FlightCase(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One flight of a search; equal cases give equal flights."""

    mission: str
    """A file, or the name of an example."""
    platform: str
    autopilot: str = ""
    """`px4` or `ardupilot`; empty for the vehicle's usual one."""
    seed: int = 0
    wind_m_s: float = 0.0
    """Gusty, from the west."""
    waves_m: float = 0.0
    current_m_s: float = 0.0
    world: str = ""
    faults: tuple[str, ...] = ()
    """As `gloc3 fly --fault` takes them."""
    text: str = ""
    """Of the mission where it is no longer the file's: a shortened one."""
    home: GeoPoint | None = None
    """With a text that was converted from a plan: the plan's home."""
    platform_text: str = ""
    """The platform file with its bases, where it is not an installed one and the case is to be replayed elsewhere."""
    world_text: str = ""
    """The world's file, likewise."""

    def line(self) -> str:
        """The case as one line of JSON: a replay file, and a row of a table of cases."""
        return msgspec.json.encode(self).decode()

    def command(self, mission: str = "") -> str:
        """The command that flies it.

        Args:
            mission: the file that holds `text`, where there is one.
        """
        words = ["gloc3", "fly", mission or self.mission, "--platform", self.platform]
        words += ["--autopilot", self.autopilot] if self.autopilot else []
        words += ["--seed", str(self.seed)] if self.seed else []
        for name, value in (("wind", self.wind_m_s), ("waves", self.waves_m), ("current", self.current_m_s)):
            words += [f"--{name}", f"{value:g}"] if value else []
        words += ["--world", self.world] if self.world else []
        for fault in self.faults:
            words += ["--fault", fault]
        return shlex.join(words)

    def contained(self) -> "FlightCase":
        """The same with the texts of its files, which may change or be elsewhere when it is replayed."""
        from gloc3.platform.reader import whole_text

        text, home, platform_text = self.text, self.home, self.platform_text
        if not text and Path(self.mission).is_file():
            text, home = self._whole_mission()
        if not platform_text and Path(self.platform).is_file():
            platform_text = whole_text(self.platform)
        world_text = self.world_text
        if not world_text and Path(self.world).is_file():
            world_text = Path(self.world).read_text(encoding="utf-8")
        return msgspec.structs.replace(self, text=text, home=home, platform_text=platform_text, world_text=world_text)

    def _whole_mission(self) -> tuple[str, GeoPoint | None]:
        """The mission with its libraries and plans, in our format, and its planned home."""
        from gloc3.mission.formats import mission_text
        from gloc3.platform.reader import load_platform
        from gloc3_sitl.flight.mission_file import read_mission_file

        with TemporaryDirectory() as scratch:
            platform = load_platform(self.platform_file(Path(scratch)))
            mission = read_mission_file(Path(self.mission), platform, Path(scratch))
            _, text, _ = mission_text(mission.file, platform)
        return text, mission.home

    def platform_file(self, folder: Path) -> str:
        """The platform's name or file; a text is written into a folder first."""
        if not self.platform_text:
            return self.platform
        path = folder / "platform.yaml"
        path.write_text(self.platform_text, encoding="utf-8")
        return str(path)

    def world_file(self, folder: Path) -> str:
        """The world's name or file, empty for none; a text is written into a folder first."""
        if not self.world_text:
            return self.world
        path = folder / "world.yaml"
        path.write_text(self.world_text, encoding="utf-8")
        return str(path)

    def file(self, folder: Path) -> Path:
        """The mission's file; a text is written into a folder first."""
        from gloc3_sitl.flight.mission_file import find_file

        if not self.text:
            return find_file(self.mission)
        path = folder / "mission.yaml"
        path.write_text(self.text, encoding="utf-8")
        return path


def read_case(path: Path) -> FlightCase:
    """Reads a replay file.

    Raises:
        Refused: there is none, or it holds no case.
    """
    try:
        case = msgspec.json.decode(path.read_bytes(), type=FlightCase)
    except OSError as error:
        raise Refused(f"{path} cannot be read: {error.strerror or error}") from error
    except UNREADABLE as error:
        raise Refused(f"{path} is no replay file: {error}") from error
    if case.seed < 0:
        raise Refused(f"{path}: the seed must be 0 or more")
    for text in case.faults:
        try:
            parse(text)
        except ValueError as error:
            raise Refused(f"{path}: the times of the fault {text!r} cannot be read") from error
    return case
