"""Targets of files that people write and exchange: missions, platforms, plans, networks, YAML of any kind."""

from datetime import UTC, datetime
from typing import Any, Final

from tests.fuzz.target import PART, as_file, as_folder, fuzz_target, refuses

from gloc3.documents.document import dump, parse, read
from gloc3.evaluation.trajectory import read_trajectory
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.formats import ForeignPlan
from gloc3.mission.formats.plan import read_plan, write_plan
from gloc3.mission.formats.to_mission import to_mission
from gloc3.mission.formats.wpl import read_wpl, write_wpl
from gloc3.mission.reading.library import bundled
from gloc3.mission.reading.reader import read_mission
from gloc3.mission.reading.writer import write_mission
from gloc3.network.file import read_network
from gloc3.network.register import REGISTER, read_register
from gloc3.platform.reader import load_platform, read_platform

NOW: Final = datetime(2026, 1, 1, tzinfo=UTC)
PLATFORM: Final = load_platform("pelican_rtk")


@fuzz_target("gloc3.documents", "yaml")
def yaml_document(data: bytes) -> None:
    """Any bytes are a document, or findings with places; what is read is written so that it is read the same."""

    def whole() -> None:
        value = parse(data, "f").value
        assert parse(dump(value), "f").value == value or value != value

    refuses(whole)
    refuses(lambda: read(data, dict[str, Any], "f"))


@fuzz_target("gloc3.mission", "gloc3.documents")
def mission_file(data: bytes) -> None:
    """Any bytes are a mission, which is read the same after it is written, or are refused with findings and places."""
    refuses(lambda: check_text(data, "f", Circumstances(platform=PLATFORM)).flyable())

    def whole() -> None:
        mission = read_mission(data, "f")
        again = read_mission(write_mission(mission), "f")
        assert set(again.actions()) == set(mission.actions())

    refuses(whole)


@fuzz_target("gloc3.mission.reading")
def mission_with_library(data: bytes) -> None:
    """A mission and a library that it includes are one text, or are refused with findings and places."""
    folder = as_folder(data, "mission.yaml", "library.yaml")

    def whole() -> None:
        text = data.partition(PART)[0].decode("utf-8-sig", "surrogateescape")
        read_mission(bundled(text, folder / "mission.yaml"), "f")

    refuses(whole)


@fuzz_target("gloc3.platform", "gloc3.documents")
def platform_file(data: bytes) -> None:
    """Any bytes are a platform, or are refused with findings and places."""
    refuses(lambda: read_platform(data, "f", warn=lambda finding: None))


def _converted(plan: ForeignPlan) -> None:
    """A plan that is read is a mission that can be read, or is refused."""

    def whole() -> None:
        text, _ = to_mission(plan, "plan", "f", PLATFORM)
        report = check_text(text, "f", Circumstances(platform=PLATFORM))
        assert report.is_ok or report.findings

    refuses(whole)


@fuzz_target("gloc3.mission.formats")
def qgroundcontrol_plan(data: bytes) -> None:
    """Any bytes are a plan, which is written and read the same and becomes a mission or is refused, or are findings."""

    def whole() -> None:
        plan = read_plan(data, "f")
        again = read_plan(write_plan(plan), "f")
        assert (again.items, again.fence, again.rally) == (plan.items, plan.fence, plan.rally)
        _converted(plan)

    refuses(whole)


@fuzz_target("gloc3.mission.formats")
def waypoint_file(data: bytes) -> None:
    """Any bytes behind the first line are waypoints, written and read the same, or are refused with findings and places."""

    def whole(given: bytes) -> None:
        plan = read_wpl(given, "f")
        assert read_wpl(write_wpl(plan), "f").items == plan.items
        _converted(plan)

    refuses(lambda: whole(data))
    refuses(lambda: whole(b"QGC WPL 110\n" + data))


@fuzz_target("gloc3.network")
def network_file(data: bytes) -> None:
    """A network file, a register and the certificates beside them are used, or refused with findings and places."""
    folder = as_folder(data, "network.yaml", "certificate.pem", "key.pem", "authority.pem")
    refuses(lambda: read_network(folder / "network.yaml", NOW))
    as_file(data, f"folder/{REGISTER}")
    refuses(lambda: read_register(folder))


@fuzz_target("gloc3.evaluation")
def trajectory_file(data: bytes) -> None:
    """Any bytes are a trajectory whose times grow, or are refused with a place."""
    refuses(lambda: read_trajectory(as_file(data)))
