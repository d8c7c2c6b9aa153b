"""A mission file before it goes anywhere: read, and checked as far as the platform is known here."""

from pathlib import Path

from gloc3.errors import InputError
from gloc3.mission.checker import Circumstances, check_file
from gloc3.platform import Platform, find_platform, load_platform
from gloc3_groundstation.flights import Plan


def read_plan(name: str, platform: str | None = None) -> Plan:
    """Reads and checks a mission.

    Args:
        name: a file, or the name of an example.
        platform: the platform's name; where its file is installed here too the check is as strict as onboard.

    Raises:
        InputError: it may not fly; with everything that is wrong.
    """
    report = check_file(name, Circumstances(platform=_known(platform)))
    mission = report.flyable()
    return Plan(
        name=Path(report.file).name,
        title=mission.name,
        text=mission.text,
        warnings=tuple(str(finding) for finding in report.findings),
    )


def _known(name: str | None) -> Platform | None:
    """The platform of that name, if its file is here."""
    if name is None:
        return None
    try:
        find_platform(name)
    except InputError:
        return None
    return load_platform(name)
