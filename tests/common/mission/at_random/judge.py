"""Draws, checks, flies and watches one mission for each seed."""

from random import Random
from typing import Any, NamedTuple

import yaml
from tests.common.mission.at_random.draw import draw_mission
from tests.common.mission.at_random.fly import CALM, FAILING, RESTARTS, STORM, TROUBLED, Command, Flight, Weather
from tests.common.mission.at_random.observer import Observer
from tests.common.mission.conftest import PELICAN

from gloc3.errors import Finding
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.model.model import Mission
from gloc3.platform.reader import read_platform

PLANS = "  fly_plan: {arguments: follow_waypoints, performed_by: plans, claims: [motion], needs: [pose, autopilot]}\n"
TEXT = (
    PELICAN.replace("height_max_m: 10", "height_max_m: 10, survey_height_m: 2")
    .replace("capabilities:\n", f"capabilities:\n{PLANS}")
    .replace("components:\n", 'components:\n  - {name: plans, class: "nowhere:Plans", rate_hz: 20}\n')
)
"""A quadrotor with a ground camera, whose autopilot flies plans, too."""
PLATFORM = read_platform(TEXT, "pelican.yaml")
ROWS = yaml.safe_load(TEXT)["capabilities"]
CIRCUMSTANCES = Circumstances(platform=PLATFORM, home_ned_m=(0.0, 0.0, 0.0))
WEATHERS = (CALM, FAILING, RESTARTS, TROUBLED, STORM)
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class Case(NamedTuple):
    """The mission of a seed, checked."""

    seed: int
    flaw: str
    """What was made wrong with it on purpose; empty for nothing."""
    errors: tuple[Finding, ...]
    """Why it may not fly."""
    mission: Mission | None
    """None where it may not fly."""
    document: dict[str, Any]
    """What its file says; empty where it may not fly."""


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


def case(seed: int) -> Case:
    """Draws and checks the mission of a seed."""
    drawn = draw_mission(Random(seed))
    report = check_text(drawn.text, "drawn.yaml", CIRCUMSTANCES)
    errors = tuple(finding for finding in report.findings if not finding.is_warning)
    if not report.is_ok:
        return Case(seed, drawn.flaw, errors, None, {})
    return Case(seed, drawn.flaw, errors, report.flyable(), yaml.load(drawn.text, Loader=LOADER))


def judge(seed: int) -> Judgement:
    """Draws the mission of a seed, and flies it if it may; the weather goes by the seed, too."""
    return fly(case(seed), WEATHERS[seed % len(WEATHERS)])


def fly(of: Case, weather: Weather = CALM, commands: tuple[Command, ...] = ()) -> Judgement:
    """Flies a case, if it may fly.

    Args:
        of: the case.
        weather: what befalls it.
        commands: what operators do beside that.
    """
    if of.mission is None:
        return Judgement(of.flaw, False, of.errors, (), "", 0, 0, 0)
    flight = Flight(PLATFORM, of.mission, Random(of.seed), weather, commands)
    log = flight.run()
    violations = Observer(of.document, ROWS).watch(log)
    state = next(entry.data[""] for entry in reversed(log) if entry.kind == "states")
    kinds = [entry.kind for entry in log]
    return Judgement(
        of.flaw,
        True,
        of.errors,
        tuple(violations),
        state,
        kinds.count("restarts"),
        kinds.count("command") + kinds.count("refused"),
        flight.steps,
    )


def steps_and_targets(of: Case, weather: Weather = CALM) -> tuple[int, tuple[str, ...]]:
    """How many steps a flight has, and what can be steered in it; 0 where it may not fly."""
    if of.mission is None:
        return 0, ()
    ready = of.mission.contingencies if weather.troubles_s else {}
    actions = [f"{name}.{one}" for name, task in ready.items() for one in task.actions]
    return fly(of, weather).steps, ("", *of.mission.tasks, *of.mission.actions(), *ready, *actions)
