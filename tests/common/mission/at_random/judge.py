"""Draws, checks, flies and watches one mission for each seed."""

from random import Random
from typing import NamedTuple

import yaml
from tests.common.mission.at_random.draw import draw_mission
from tests.common.mission.at_random.fly import CALM, FAILING, RESTARTS, STORM, Command, Flight
from tests.common.mission.at_random.observer import Observer
from tests.common.mission.conftest import PELICAN

from gloc3.errors import Finding
from gloc3.mission.checker import Circumstances, check_text
from gloc3.platform import read_platform

PLATFORM = read_platform(PELICAN, "pelican.yaml")
ROWS = yaml.safe_load(PELICAN)["capabilities"]
CIRCUMSTANCES = Circumstances(platform=PLATFORM, home_ned_m=(0.0, 0.0, 0.0))
WEATHERS = (CALM, FAILING, RESTARTS, STORM)


class Judgement(NamedTuple):
    """What became of one mission."""

    flaw: str
    """What was made wrong with it on purpose; empty for nothing."""
    is_flown: bool
    errors: tuple[Finding, ...]
    """Why it may not fly."""
    violations: tuple[str, ...]
    """The rules that its flight has broken."""
    state: str
    """Of the mission in the end."""
    restarts: int
    commands: int
    steps: int

    @property
    def wrong(self) -> tuple[str, ...]:
        """What must never be: a broken rule, a flaw that was accepted, or a refusal without a reason and its place."""
        accepted = (f"it may fly, with {self.flaw}",) if self.is_flown and self.flaw else ()
        unfounded = () if self.is_flown or self.errors else ("it may not fly, and nothing is said",)
        vague = tuple(f"{one} has no place" for one in self.errors if min(one.line, one.column) < 1 or not one.message)
        return (*self.violations, *accepted, *unfounded, *vague)


def steps_and_targets(seed: int) -> tuple[int, tuple[str, ...]]:
    """How many steps the flight of a seed has in calm weather, and what can be steered in it; 0 where it may not fly."""
    drawn = draw_mission(Random(seed))
    report = check_text(drawn.text, "drawn.yaml", CIRCUMSTANCES)
    if not report.is_ok:
        return 0, ()
    mission = report.flyable()
    return judge(seed, ()).steps, ("", *mission.tasks, *mission.actions())


def judge(seed: int, commands: tuple[Command, ...] | None = None) -> Judgement:
    """Draws the mission of a seed, and flies it if it may; the weather goes by the seed.

    Args:
        seed: of everything.
        commands: what operators do, in calm weather; None for the weather's own.
    """
    drawn = draw_mission(Random(seed))
    report = check_text(drawn.text, "drawn.yaml", CIRCUMSTANCES)
    errors = tuple(finding for finding in report.findings if not finding.is_warning)
    if not report.is_ok:
        return Judgement(drawn.flaw, False, errors, (), "", 0, 0, 0)
    weather = WEATHERS[seed % len(WEATHERS)] if commands is None else CALM
    flight = Flight(PLATFORM, report.flyable(), Random(seed), weather, commands or ())
    log = flight.run()
    violations = Observer(yaml.safe_load(drawn.text), ROWS).watch(log)
    state = next(entry.data[""] for entry in reversed(log) if entry.kind == "states")
    kinds = [entry.kind for entry in log]
    return Judgement(
        drawn.flaw,
        True,
        errors,
        tuple(violations),
        state,
        kinds.count("restarts"),
        kinds.count("command") + kinds.count("refused"),
        flight.steps,
    )
