"""QGroundControl's sequences, replayed through our router to the autopilot and to the onboard computer."""

from contextlib import closing
from pathlib import Path

import pytest
from tests.onboard.onboard_scene import LATITUDE_DEG, LONGITUDE_DEG, Scene, vehicle
from tests.onboard.qgc_sequences import (
    AUTOPILOT,
    AUTOPILOT_VERSION,
    COMPANION,
    COMPONENT_METADATA,
    REQUEST_OPERATOR_CONTROL,
    Station,
    waypoint,
)

from gloc3.log.reader import LogReader

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

MISSION, FENCE, RALLY = 0, 1, 2
ACCEPTED, UNSUPPORTED = 0, 3
PLAN = [
    waypoint(22, LATITUDE_DEG, LONGITUDE_DEG, 3.0),
    waypoint(16, LATITUDE_DEG + 3e-5, LONGITUDE_DEG, 3.0),
    (20, 2, (0.0, 0.0, 0.0, 0.0), 0, 0, 0.0),
]
CIRCLE = [(5003, 0, (80.0, 0.0, 0.0, 0.0), round(LATITUDE_DEG * 1e7), round(LONGITUDE_DEG * 1e7), 0.0)]
RALLY_POINT = [(5100, 3, (0.0, 0.0, 0.0, 0.0), round(LATITUDE_DEG * 1e7), round(LONGITUDE_DEG * 1e7), 10.0)]


def loaded(scene: Scene) -> set[str]:
    """Names of the missions that were loaded in a run."""
    with LogReader(scene.out / "log.mcap") as log:
        return {entry.envelope.payload.name for entry in log.entries("ci/mission")} - {""}


@pytest.mark.parametrize("style", ["px4", "ardupilot"])
def test_it_connects_and_its_plan_goes_where_it_is_sent(style: str, tmp_path: Path) -> None:
    with vehicle(tmp_path, style=style) as scene, closing(Station(scene.port)) as qgc:
        parameters = qgc.connect()
        assert set(parameters) == {AUTOPILOT, COMPANION}, "complete, of both"
        assert "HEIGHT_MAX_M" in parameters[COMPANION]
        for kind, items in ((MISSION, PLAN), (FENCE, CIRCLE), (RALLY, RALLY_POINT)):
            assert qgc.write_plan(AUTOPILOT, kind, items) == ACCEPTED
            assert len(qgc.read_plan(AUTOPILOT, kind)) == len(items)

        version = qgc.request(COMPANION, AUTOPILOT_VERSION, "AUTOPILOT_VERSION")
        assert version.capabilities & 16384, "it takes fences"
        assert not version.capabilities & 32768, "and no rally points"
        assert qgc.request(COMPANION, COMPONENT_METADATA, f"UNKNOWN_{COMPONENT_METADATA}") is not None
        assert qgc.has_file(COMPANION, "/metadata/general.json")
        assert not qgc.has_file(COMPANION, "@PARAM/param.pck")
        assert qgc.command(COMPANION, REQUEST_OPERATOR_CONTROL, 1.0, 0.0, 10.0, 255.0) == ACCEPTED
        for kind, items, expected in ((MISSION, PLAN, ACCEPTED), (FENCE, CIRCLE, ACCEPTED), (RALLY, [], ACCEPTED)):
            assert qgc.write_plan(COMPANION, kind, items) == expected
        assert qgc.write_plan(COMPANION, RALLY, RALLY_POINT) == UNSUPPORTED
        assert len(qgc.read_plan(COMPANION, MISSION)) == len(PLAN)
        assert qgc.command(COMPANION, REQUEST_OPERATOR_CONTROL, 0.0, 0.0, 0.0, 255.0) == ACCEPTED
    assert loaded(scene) == {"plan of station 255"}


def test_what_it_uploads_to_its_vehicle_becomes_a_mission_where_that_is_asked_for(tmp_path: Path) -> None:
    with vehicle(tmp_path, "--take-plans") as scene, closing(Station(scene.port)) as qgc:
        qgc.connect()
        for kind, items in ((MISSION, PLAN), (FENCE, CIRCLE), (RALLY, [])):
            assert qgc.write_plan(AUTOPILOT, kind, items) == ACCEPTED
        assert [item.command for item in qgc.read_plan(AUTOPILOT, MISSION)] == [22, 16, 20]
        assert qgc.write_plan(AUTOPILOT, MISSION, [waypoint(82, 0.0, 0.0, 0.0)]) == UNSUPPORTED
        assert "mission refused: item 0: command 82 cannot be expressed in a mission" in "".join(qgc.texts)
    assert "refused of other programs' stations" in scene.onboard.text
    assert loaded(scene) == {"plan of station 255"}
