"""Platform files are read into a typed model, or refused with everything that is wrong in them."""

import re
from pathlib import Path

import pytest

from gloc3.errors import Finding, InputError
from gloc3.platform.reader import find_platform, load_platform, read_platform, whole_text

PELICAN = """\
platform: pelican
vehicle: {type: quadrotor, mass_kg: 1.65}
arm: true
frames: {hold: {origin: {geo: [39.5, 2.6, 5.0]}, x_axis_bearing_deg: 90}}
limits: {speed_m_s: 3.0, climb_m_s: 1.0, height_max_m: 20}
power: {hover_w: 165, per_m_s_w: 6, climb_w_per_m_s: 25, avionics_w: 12, battery_wh: 71, reserve: 0.25}
failsafes: {link_loss: {action: continue}, low_battery: {action: return, at: 0.2}}
capabilities:
  take_off: {arguments: take_off, performed_by: flight, claims: [motion], needs: [pose]}
  land: {arguments: land, performed_by: flight, claims: [motion]}
  hold: {arguments: hold, performed_by: flight, claims: [motion]}
  return_home: {arguments: return_home, performed_by: flight, claims: [motion]}
components:
  - {name: pose, class: "somewhere:Pose", rate_hz: 20, required: yes}
  - {name: flight, class: "somewhere:Flight", rate_hz: 20, on_fault: land}
"""


def findings(text: str, *, is_loading_classes: bool = False) -> list[str]:
    with pytest.raises(InputError) as caught:
        read_platform(text, "p", is_loading_classes=is_loading_classes)
    return [str(finding) for finding in caught.value.findings]


def test_a_platform_is_read_with_its_frames_limits_and_components() -> None:
    platform = read_platform(PELICAN, "p")
    assert platform.local_frames()["hold"].to_ned((1.0, 0.0, 2.0)) == pytest.approx((0.0, 1.0, -2.0))
    assert platform.limits.height_min_m == 0.3
    assert platform.power is not None
    assert platform.power.usable_wh == pytest.approx(53.25)
    assert [row.name for row in platform.components] == ["pose", "flight"]
    assert platform.component("pose") is platform.components[0]
    assert platform.component("nobody") is None


def test_names_that_refer_to_nothing_are_found_with_the_nearest_one() -> None:
    text = (
        PELICAN.replace("performed_by: flight, claims: [motion], needs", "performed_by: fligt, claims: [motion], needs")
        .replace("arguments: land", "arguments: lnd")
        .replace("rate_hz: 20, required: yes", "standby_for: pos, on_fault: {standby: flight}")
    )
    assert findings(text) == [
        "p:9:49: no component 'fligt' (did you mean 'flight'?)",
        "p:10:21: unknown kind of arguments 'lnd' (did you mean 'land'?)",
        "p:14:5: component pose would never work (give rate_hz, or trigger with the name of an input)",
        "p:14:56: no other component 'pos' (known: flight)",
        "p:14:81: 'flight' is no standby for it (give flight the row entry standby_for: pose)",
    ]


def test_wrong_types_and_unknown_keys_are_found_at_their_places() -> None:
    text = (
        PELICAN.replace("mass_kg: 1.65", "mass: 2").replace("reserve: 0.25", "reserve: 2").replace("quadrotor", "quad")
    )
    assert findings(text) == [
        "p:2:10: 'mass_kg' is missing in vehicle",
        "p:2:17: type: 'quad' is not possible here (did you mean 'quadrotor'?)",
        "p:2:23: unknown key 'mass' (did you mean 'mass_kg'?)",
        "p:6:99: reserve: expected a number <= 1.0 (2)",
    ]


def test_a_platform_that_moves_needs_the_capabilities_that_policies_are_flown_with() -> None:
    lines = [line for line in PELICAN.splitlines() if "return_home" not in line]
    assert findings("\n".join(lines)) == ["p:9:3: the capability 'return_home' is missing (mission policies use it)"]


def test_a_height_band_without_room_is_refused() -> None:
    found = findings(PELICAN.replace("height_max_m: 20", "height_max_m: 0.2"))
    assert found == ["p:5:9: limits: height_min_m must be less than height_max_m"]


def test_a_second_component_of_one_name_is_refused() -> None:
    assert "p:15:12: a second component 'pose' (names are unique on a platform)" in findings(
        PELICAN.replace("name: flight", "name: pose")
    )


def test_classes_that_cannot_be_loaded_are_findings_when_asked_for() -> None:
    found = findings(PELICAN, is_loading_classes=True)
    assert found[0].startswith("p:14:25: component pose: cannot load 'somewhere:Pose'")
    assert found[1].startswith("p:15:27: component flight: cannot load 'somewhere:Flight'")


def test_ports_settings_and_needs_are_checked_against_the_classes() -> None:
    text = (
        PELICAN.replace('"somewhere:Pose"', '"platform_parts:Steady"')
        .replace('"somewhere:Flight"', '"platform_parts:Steady"')
        .replace("required: yes", "ports: {outt: pose}, settings: {gian: 3}, log: [lvel], trigger: inn")
        .replace("needs: [pose]", "needs: [poze]")
    )
    found = findings(text, is_loading_classes=True)
    assert [re.sub(r" \(known: .*", "", line.partition(": ")[2]) for line in found] == [
        "flight does not perform take_off (Steady performs no actions)",
        "no topic, capability or component 'poze' (did you mean 'pose'?)",
        "flight does not perform land (Steady performs no actions)",
        "flight does not perform hold (Steady performs no actions)",
        "flight does not perform return_home (Steady performs no actions)",
        "unknown topic 'out' (did you mean 'route'?)",
        "Steady has no port 'outt' (did you mean 'out'?)",
        "unknown key 'gian' (did you mean 'gain'?)",
        "Steady cannot log 'lvel' (did you mean 'level'?)",
        "Steady has no input 'inn' (none is known)",
        "'out' is an output of pose already (bind 'out' to another topic, or say standby_for: pose)",
        "unknown topic 'out' (did you mean 'route'?)",
    ]


@pytest.fixture(autouse=True)
def _parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """A module with a component class, as an installed package would bring it."""
    import sys
    import types
    from collections.abc import Sequence

    from gloc3.component.component import DataProcessor
    from gloc3.component.ports import Inbox, Output, Result
    from gloc3.component.settings import Settings
    from gloc3.messages.envelope import Message

    class Out(Message, frozen=True):
        value: float = 0.0

    class SteadySettings(Settings, frozen=True):
        gain: float = 1.0

    class Steady(DataProcessor[SteadySettings]):
        loggable = ("level",)
        out = Output(Out)

        def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
            return ()

    module = types.ModuleType("platform_parts")
    module.Steady = Steady  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "platform_parts", module)


def test_a_platform_is_found_by_its_path_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(PELICAN)
    assert load_platform(str(path)).platform == "pelican"
    with pytest.raises(InputError, match="no such platform"):
        find_platform("no_platform_of_that_name")


def test_what_is_doubtful_but_can_fly_is_told_as_a_warning(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    text = whole_text("pelican_rtk")
    text = text.replace("ports: {image: camera/ground}, dev", "ports: {image: camera/grond}, dev")
    text = text.replace("\ncapabilities:\n", "\ndevices:\n  ground_camra: v4l2:///dev/video0\ncapabilities:\n", 1)
    path.write_text(text)
    line = next(n for n, row in enumerate(text.splitlines(), start=1) if "name: ground_recorder" in row)
    unused = next(n for n, row in enumerate(text.splitlines(), start=1) if "ground_camra" in row)
    reported: list[Finding] = []
    load_platform(str(path), is_loading_classes=True, warn=reported.append)
    assert [(finding.line, finding.message) for finding in reported] == [
        (unused, "no component uses a device 'ground_camra', so v4l2:///dev/video0 is not read"),
        (line, "no component publishes 'camera/ground'"),
    ]


@pytest.mark.parametrize(
    ("was", "now", "told"),
    [
        ("performed_by: landing", "performed_by: waypoints", "waypoints does not perform land (it performs"),
        (
            "performed_by: landing",
            "performed_by: limiter",
            "limiter does not perform land (Limiter performs no actions)",
        ),
        (", setpoint_wanted/hold", "", "nothing reads 'setpoint_wanted/hold', by which hold moves the vehicle"),
    ],
)
def test_a_capability_that_would_do_nothing_is_found(was: str, now: str, told: str) -> None:
    text = (Path(__file__).parents[2] / "data" / "platforms" / "pelican_rtk.yaml").read_text(encoding="utf-8")
    found = findings(text.replace(was, now), is_loading_classes=True)
    assert any(told in finding for finding in found), found


def test_a_folder_that_is_called_like_a_platform_is_not_taken_for_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "pelican").mkdir()
    monkeypatch.chdir(tmp_path)
    assert find_platform("pelican").name == "pelican.yaml"


def test_a_file_that_has_the_name_of_an_installed_one_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pelican_rtk.yaml").write_text(whole_text("pelican_rtk"))
    told: list[Finding] = []
    load_platform("pelican_rtk", warn=told.append)
    assert [str(one.file) for one in told] == ["pelican_rtk.yaml"]
    assert "is not used" in told[0].message
    told.clear()
    load_platform("pelican_rtk.yaml", warn=told.append)
    load_platform("boat", warn=told.append)
    assert told == []


def test_topics_of_the_log_are_checked_against_those_that_there_are() -> None:
    text = (Path(__file__).parents[2] / "data" / "platforms" / "pelican_rtk.yaml").read_text(encoding="utf-8")
    good = "log: {camera/*: 2, imu: true, pose: false, setpoint_wanted/hold: 0.5}\n"
    assert read_platform(text + good, "pelican_rtk.yaml", is_loading_classes=True).log["camera/*"] == 2.0
    (wrong,) = findings(text + "log: {lasers: true}\n", is_loading_classes=True)
    assert "no topic fits 'lasers'" in wrong
    assert "did you mean 'laser'" in wrong
    assert any("imu: expected" in finding for finding in findings(text + "log: {imu: -1}\n"))
