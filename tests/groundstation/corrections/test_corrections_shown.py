"""What the operator is shown of corrections: lines of the overview, the alert, refusals, the configuration file."""

from pathlib import Path

import pytest
from msgspec.structs import replace
from tests.groundstation.scripted_platform import VEHICLE
from tests.groundstation.tui.views.test_views import PLATFORM, texts, view

from gloc3.errors import InputError, Refused
from gloc3.messages.frames import GeoPoint, ecef_from_geo
from gloc3_groundstation.cli.station import app
from gloc3_groundstation.station import alerts
from gloc3_groundstation.station.snapshots import AutopilotSnapshot, CorrectionsSnapshot, Timed
from gloc3_groundstation.store.configuration import ConfigurationFile
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.overview import detail_lines

AUTOPILOT = AutopilotSnapshot(link="x", system=1, component=1, firmware="PX4", fix_type=6, has_used_rtk=True)
SHOWN = CorrectionsSnapshot(
    source="ntrip://caster/BASE",
    rate_byte_s=980.4,
    received_s=99.6,
    types=(1005, 1077),
    base_ecef_m=ecef_from_geo(GeoPoint(47.41, 8.5456, 488.0)),
    links=1,
)


def with_corrections(corrections: CorrectionsSnapshot | None, autopilot: AutopilotSnapshot = AUTOPILOT) -> StationView:
    vehicle = replace(VEHICLE, geo=(47.3977, 8.5456, 488.0))
    shown = view(replace(PLATFORM, autopilot=autopilot, vehicle=Timed(vehicle, 100.0)))
    return shown._replace(fleet=replace(shown.fleet, corrections=corrections))


def rows(corrections: CorrectionsSnapshot | None) -> list[str]:
    lines = [line.removeprefix(" ").rstrip() for line in texts(detail_lines(with_corrections(corrections)))]
    start = next((number for number, line in enumerate(lines) if line.startswith("rtk")), len(lines))
    end = next(number for number, line in enumerate(lines) if line.startswith("charge"))
    return [line.split(None, 1)[-1] if number == 0 else line.strip() for number, line in enumerate(lines[start:end])]


def test_the_overview_shows_fix_age_rate_base_and_types() -> None:
    assert rows(None) == []
    assert rows(SHOWN) == ["RTK fixed, 0.4 s, 980 B/s", "base 1.4 km away", "RTCM 1005 1077"]
    assert " ".join(rows(replace(SHOWN, damaged=2, oversized=1, left_out=30))).endswith(
        "frames dropped: 2 damaged, 1 too long, 30 left out"
    )
    old = rows(replace(SHOWN, received_s=80.0, rate_byte_s=0.0, problem="caster: connection refused"))
    assert " ".join(old).startswith("RTK fixed, 20 s, 0 B/s: caster: connection refused")
    assert rows(CorrectionsSnapshot(source="x")) == ["no corrections yet"]
    assert rows(CorrectionsSnapshot(source="x", problem="caster: refused")) == ["caster: refused"]


def causes(corrections: CorrectionsSnapshot | None, autopilot: AutopilotSnapshot = AUTOPILOT) -> list[str]:
    fleet = with_corrections(corrections, autopilot).fleet
    return [cause.text for cause in alerts.causes(fleet, 100.0) if cause.what == "rtk"]


def test_old_corrections_are_an_alert_while_a_vehicle_uses_rtk() -> None:
    assert causes(SHOWN) == []
    assert causes(None) == []
    old = replace(SHOWN, received_s=89.9, problem="caster: connection refused")
    assert causes(old) == [
        "no RTK corrections for more than 10 s, its position becomes metre-level: caster: connection refused"
    ]
    assert causes(replace(old, received_s=None)) == causes(old)
    assert causes(old, replace(AUTOPILOT, fix_type=3)) == causes(old), "it has fallen back because of this"
    assert causes(old, replace(AUTOPILOT, fix_type=3, has_used_rtk=False)) == []
    assert causes(old, replace(AUTOPILOT, is_alive=False)) == []


def test_a_wrong_address_is_refused_before_anything_is_opened() -> None:
    with pytest.raises(Refused, match="no scheme 'ntripp'; did you mean") as refusal:
        app(["--headless", "--rtk", "ntripp://u:secret@h/M"], exit_on_error=False, print_error=False)
    assert "secret" not in str(refusal.value)


def test_the_configuration_file_names_the_source(tmp_path: Path) -> None:
    file = tmp_path / "station.toml"
    file.write_text('theme = "mono"\nrtk = "ntrip://u:secret@h/M"\n')
    assert ConfigurationFile(file).read().rtk == "ntrip://u:secret@h/M"
    file.write_text('theme = "mono"\nrtk = "ntrip://u:secret@h:x/M"\n')
    with pytest.raises(InputError) as refusal:
        ConfigurationFile(file).read()
    assert f"{file}:2:1: rtk: corrections from ntrip://h:x/M: the host or the port is wrong" in str(refusal.value)
    assert "secret" not in str(refusal.value)
