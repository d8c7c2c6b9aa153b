"""Bad input to every sensor of the inspection vehicle, and what each component behind it makes of it."""

from functools import partial
from typing import Any

from tests.evidence.page import Bar, Figure, Progress
from tests.evidence.suites import suite
from tests.onboard.bad_input.chains import CHAINS
from tests.onboard.bad_input.trial import INPUTS, MISFITS, Trial, faults

GOOD_S, BAD_S = 1.5, 3.0
LONGEST_REASON = 80
TESTS = (
    "tests/onboard/components/samplers/test_bad_input_of_samplers.py",
    "tests/onboard/bad_input/test_bad_input_of_chains.py",
    "tests/onboard/algorithms/vision/test_bad_pictures_at_random.py",
    "tests/onboard/algorithms/fusion/test_fusion_in_short_flights.py",
    "tests/onboard/calibration",
)


def _tried(sensor: str, name: str, is_misfit: bool, with_sampler: bool) -> dict[str, Any]:
    """One kind of bad input to one sensor for three seconds."""
    with Trial(sensor, with_sampler=with_sampler) as trial:
        trial.good(GOOD_S)
        outcomes = (trial.misfit if is_misfit else trial.bad)(name, BAD_S)
    return {
        "faults": faults(name, outcomes, is_long=True),
        "told": {one: _words(outcome.valid, outcome.invalid, outcome.reason) for one, outcome in outcomes.items()},
        "again_s": max(outcome.again_s for outcome in outcomes.values()),
        "is_finite": all(outcome.is_finite for outcome in outcomes.values()),
        "is_working": all(outcome.is_working for outcome in outcomes.values()),
    }


def _words(valid: int, invalid: int, reason: str) -> str:
    """What a component said while the input was bad."""
    if not invalid:
        return "right"
    short = reason if len(reason) <= LONGEST_REASON else reason[:LONGEST_REASON] + "…"
    return f"*{short or 'not valid'}*" + (f" ({valid} right)" if valid else "")


def matrix(progress: Progress) -> list[Figure]:
    """Every input to every sensor, marked by its sampler and past it."""
    figures: list[Figure] = []
    results: list[dict[str, Any]] = []
    kinds = [(name, one.sensors, False) for name, one in INPUTS.items()]
    kinds += [(name, sensors, True) for name, (_, sensors) in MISFITS.items()]
    for name, sensors, is_misfit in kinds:
        for sensor in sensors:
            for with_sampler in (True, False):
                work = partial(_tried, sensor, name, is_misfit, with_sampler)
                result = progress.part(f"{name}, {sensor}, {with_sampler}", work)
                results.append(result)
                value = "; ".join(f"{one}: {words}" for one, words in result["told"].items())
                title = f"{name}: {CHAINS[sensor].sensor}" + ("" if with_sampler else ", past its sampler")
                value = f"{value}; all valid again after {result['again_s']:.1f} s" if not result["faults"] else value
                value = value if not result["faults"] else f"{value}; **{', '.join(result['faults'])}**"
                figures.append(
                    Figure(title, value.replace("|", "\\|"), "told or right, then well", not result["faults"])
                )
    bad = sum(bool(result["faults"]) for result in results)
    return [
        Figure("kinds of bad input", str(len(kinds))),
        Figure("trials of 3 s between good input", str(len(results))),
        Figure("… with a component that turned faulty", *_none(results, "is_working")),
        Figure("… with a number that is none", *_none(results, "is_finite")),
        Figure("… with anything else that must not be", str(bad), "0", bad == 0),
        *figures,
        *suite("bad-sensor-input", TESTS)(progress),
    ]


def _none(results: list[dict[str, Any]], what: str) -> tuple[str, str, bool]:
    count = sum(not result[what] for result in results)
    return str(count), "0", count == 0


BARS = (
    Bar(
        "bad-sensor-input",
        "Bad sensor data is marked invalid with a reason, and every component recovers",
        "Each sensor of the inspection vehicle runs with the real components behind it, up to the pose, which has no "
        "other source here. Bad input is marked invalid with a reason (in italics), or the result is right within its "
        "covariance. A torn picture may pass for a motion of up to 0.2 m, which the fusion rejects. Everything "
        "becomes valid again without help, no component becomes faulty, and no output is NaN. *Past its sampler*: the "
        "sampler did not mark the input. A calibration is replaced by initializing the component again. A wrong focal "
        "length in one camera shows only in the disagreement of the sources ([the fusion](fusion.md)).",
        matrix,
        seeds="fixed; hypothesis chooses in the tests",
    ),
)
