"""The configuration file: what a person wrote stays, what is wrong is told with its place, nothing is lost."""

from pathlib import Path
from typing import get_args

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from gloc3.errors import InputError
from gloc3_groundstation.joysticks.mapping import AxisMapping, JoystickButton, JoystickMapping, StickAxis
from gloc3_groundstation.store.configuration import (
    RECENT_KEPT,
    Configuration,
    ConfigurationFile,
    ThemeName,
    default_path,
)
from gloc3_groundstation.tui.themes import DESCRIPTIONS, THEMES

WRITTEN = """# mine
theme = "daylight"  # for the boat
links = [
    "serial:///dev/ttyUSB0:57600",  # the radio
]

[session]
platform = "heron"
"""


def file(folder: Path, text: str | None = WRITTEN) -> ConfigurationFile:
    path = folder / "station.toml"
    if text is not None:
        path.write_text(text)
    return ConfigurationFile(path)


def test_without_a_file_there_are_the_defaults_and_one_is_made_when_something_changes(tmp_path: Path) -> None:
    kept = ConfigurationFile(tmp_path / "deep" / "station.toml")
    found = kept.read()
    assert found == Configuration()
    assert kept.write(found)
    assert not kept.path.exists(), "nothing has changed, so nothing is written"
    changed = replace(found, theme="mono").with_mission("/missions/hold.yaml")
    assert kept.write(changed)
    assert ConfigurationFile(kept.path).read() == changed


def test_comments_and_what_has_not_changed_stay_as_they_were_written(tmp_path: Path) -> None:
    kept = file(tmp_path)
    found = kept.read()
    assert found.links == ("serial:///dev/ttyUSB0:57600",)
    assert kept.write(replace(found, session=replace(found.session, screen="health")))
    assert kept.path.read_text() == WRITTEN + 'screen = "health"\n'


def test_what_was_edited_while_the_station_ran_is_not_undone(tmp_path: Path) -> None:
    kept = file(tmp_path)
    found = kept.read()
    kept.path.write_text(WRITTEN.replace("# mine", "# mine\nstation_id = 254"))
    assert kept.write(replace(found, theme="dark"))
    now = ConfigurationFile(kept.path).read()
    assert (now.station_id, now.theme) == (254, "dark")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('theme = "dark"\nlinks = [\n', "station.toml:2:1: Invalid value"),
        ("theme dark\n", "station.toml:1:7: Expected '=' after a key in a key/value pair"),
        ('theme = "dark"\nlinks = "udp"\n', "station.toml:2:1: links: Expected `array`, got `str`"),
        ('\n  theme = "pink"\n', "station.toml:2:3: theme: Invalid enum value 'pink'"),
        ("station_id = 3\n", "station.toml:1:1: station_id: must be from 200 to 255"),
        ('[session]\nscren = "health"\n', "station.toml:2:1: unknown setting 'scren' (did you mean 'screen'?)"),
        ("[session]\nmissions = [1]\n", "station.toml:2:1: missions: Expected `str`, got `int`"),
        ("session = 3\n", "station.toml:1:1: session: Expected `object`, got `int`"),
    ],
)
def test_a_bad_file_is_told_with_its_place_and_never_written(tmp_path: Path, text: str, told: str) -> None:
    kept = file(tmp_path, text)
    with pytest.raises(InputError) as caught:
        kept.read()
    assert told in str(caught.value)
    assert not kept.write(Configuration(theme="mono"))
    assert kept.path.read_text() == text


def test_a_file_that_went_bad_while_the_station_ran_is_left_alone(tmp_path: Path) -> None:
    kept = file(tmp_path)
    found = kept.read()
    kept.path.write_text("theme = [")
    assert not kept.write(replace(found, theme="dark"))
    assert kept.path.read_text() == "theme = ["


def test_mappings_of_joysticks_are_kept_one_by_one_and_removed_when_they_are_reset(tmp_path: Path) -> None:
    kept = file(tmp_path)
    found = kept.read()
    surge = {StickAxis.SURGE: AxisMapping(axis=4, low=1.0, high=-1.0)}
    pad = JoystickMapping(name="Pad", axes=surge, buttons={JoystickButton.DEAD_MAN: ("button 4", "axis 5+")})
    two = {"0300": pad, "Some: Stick, v2": msgspec.structs.replace(pad, name="Stick")}
    assert kept.write(replace(found, joysticks=two))
    assert kept.path.read_text().startswith(WRITTEN.rstrip()), "what a person wrote stays"
    assert file(tmp_path, None).read().joysticks == two
    assert kept.write(replace(found, joysticks={"0300": pad}))
    assert file(tmp_path, None).read().joysticks == {"0300": pad}
    kept.path.write_text('[joysticks."0300".axes.surge]\naxis = 99\n')
    with pytest.raises(InputError, match=r"station.toml:2:1: axis: Expected `int` <= 63"):
        kept.read()


def test_bytes_that_are_no_text_and_folders_are_told(tmp_path: Path) -> None:
    kept = file(tmp_path)
    kept.path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="no UTF-8 text"):
        kept.read()
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        ConfigurationFile(tmp_path).read()


def test_recent_missions_are_few_and_the_last_comes_first() -> None:
    configuration = Configuration()
    for number in range(RECENT_KEPT + 3):
        configuration = configuration.with_mission(f"{number}.yaml")
    configuration = configuration.with_mission("5.yaml")
    assert configuration.session.missions[:2] == ("5.yaml", f"{RECENT_KEPT + 2}.yaml")
    assert len(configuration.session.missions) == RECENT_KEPT


def test_the_file_is_where_xdg_says() -> None:
    assert default_path({"XDG_CONFIG_HOME": "/etc/xdg", "HOME": "/home/me"}) == Path("/etc/xdg/gloc3/station.toml")
    assert default_path({"HOME": "/home/me"}) == Path("/home/me/.config/gloc3/station.toml")
    assert default_path({"XDG_CONFIG_HOME": "not/absolute", "HOME": "/home/me"}).parts[:3] == ("/", "home", "me")


def test_every_theme_that_the_file_may_name_exists() -> None:
    assert list(get_args(ThemeName)) == [theme.name for theme in THEMES] == list(DESCRIPTIONS)


@given(st.text(max_size=60))
def test_any_text_is_read_or_told(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.getbasetemp() / "any.toml"
    path.write_text(text, encoding="utf-8", errors="ignore", newline="")
    try:
        reported = repr(ConfigurationFile(path).read())
    except InputError as error:
        reported = str(error)
    assert reported.startswith(("Configuration(", str(path)))
