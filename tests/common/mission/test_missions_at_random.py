"""Missions drawn at random, right ones and flawed ones: what the checker accepts never breaks a rule in flight.

The rules are judged by an observer that knows the file and the log alone.
"""

from random import Random

import pytest
from tests.common.mission.at_random.fly import CALM, Command
from tests.common.mission.at_random.judge import case, fly, judge, steps_and_targets
from tests.common.mission.at_random.mutants import MUTANTS, Mutant, broken

pytestmark = pytest.mark.thorough

STEERED = 32
"""The seed of a mission that is steered at every step."""


@pytest.mark.parametrize("first", range(0, 300, 100))
def test_no_mission_breaks_a_rule_in_any_weather_and_no_refusal_is_without_a_place(first: int) -> None:
    judged = {seed: judge(seed) for seed in range(first, first + 100)}
    assert {seed: one.wrong for seed, one in judged.items() if one.wrong} == {}
    flown = [one for one in judged.values() if one.is_flown]
    assert len(flown) > 50
    assert {"done", "failed"} <= {one.state for one in flown}
    assert sum(one.restarts for one in flown) > 20
    assert sum(not one.is_flown for one in judged.values() if one.flaw) > 10


@pytest.mark.parametrize("seed", [3634], ids=["a restart right after another time was put on disk"])
def test_no_rule_is_broken_in_missions_that_once_seemed_to(seed: int) -> None:
    assert judge(seed).wrong == ()


@pytest.mark.parametrize("verb", ["pause", "resume", "skip", "abort"])
def test_whatever_an_operator_does_at_any_step_no_rule_is_broken(verb: str) -> None:
    steered = case(STEERED)
    steps, targets = steps_and_targets(steered)
    assert steps > 20
    random = Random(verb)
    for step in range(1, steps):
        target = random.choice(targets)
        assert fly(steered, CALM, (Command(step, verb, target),)).wrong == (), f"{verb} {target} at step {step}"


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_the_observer_finds_what_is_broken_in_the_executor(mutant: Mutant) -> None:
    with broken(mutant):
        assert any(judge(seed).wrong for seed in range(mutant.seed, mutant.seed + 20))
    assert not judge(mutant.seed).wrong
