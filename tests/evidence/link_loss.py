"""Every cell of the matrix of link losses, flown in both styles of autopilot."""

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from tests.evidence.page import Bar, Figure, Progress
from tests.flight.card import Card
from tests.flight.conftest import STYLES
from tests.flight.link_loss import LINKS, LOSSES, PHASES, Case, Found, fall, fly

NO_NOTICE = -1.0


def flown(case: Case) -> dict[str, Any]:
    """How one cell ends, or why it is not as it should be."""
    with tempfile.TemporaryDirectory() as name:
        card = Card(case.style, Path(name))
        try:
            found = fall(card) if case.loss == "fall" else fly(card, case)
        except AssertionError as error:
            return {"problem": str(error).strip().splitlines()[0]}
        finally:
            card.close()
        failures = [str(failure) for failure in card.failures]
        return {"problem": failures[0], "found": None} if failures else {"found": msgspec.to_builtins(found)}


def matrix(progress: Progress) -> list[Figure]:
    """One figure a link, phase and loss, of both styles."""
    figures, good, count = [], 0, 0
    for link in LINKS:
        for phase in PHASES:
            for loss in LOSSES:
                reported, problems = [], []
                for style in STYLES:
                    case = Case(style, link, phase, loss)
                    result = progress.part("/".join(case), partial(flown, case))
                    count += 1
                    if result.get("problem"):
                        problems.append(f"{style}: {result['problem']}")
                        continue
                    good += 1
                    reported.append(_words(style, msgspec.convert(result["found"], Found)))
                figures.append(
                    Figure(
                        f"{link}, {phase}, {loss}",
                        "; ".join([*reported, *problems]),
                        "noticed, shown, acted upon, recovered",
                        not problems,
                    )
                )
    for style in STYLES:
        result = progress.part(f"{style}/fall", partial(flown, Case(style, "autopilot", "mission", "fall")))
        count, good = count + 1, good + (not result.get("problem"))
        words = result.get("problem") or _words(style, msgspec.convert(result["found"], Found))
        named = f"autopilot boots anew in the air, {style}"
        figures.append(Figure(named, words, "noticed, not armed again, recovered", not result.get("problem")))
    return [Figure("cells as they should be", f"{good} of {count}", "all", good == count), *figures]


def _words(style: str, found: Found) -> str:
    noticed = f"noticed after {found.noticed_s:.1f} s, " if found.noticed_s > NO_NOTICE else ""
    return f"{style}: {noticed}{found.policy or 'went on'}, then {found.end}"


BARS = (
    Bar(
        "link-loss",
        "A lost link is noticed, handled and recovered from in every phase of a flight",
        "The link to the station, or to the autopilot, is lost while the vehicle is idle, takes off, flies its "
        "mission, is paused or lands. The loss is shorter than any reaction (2 s, 0.25 s), long (8 s, 6 s), or "
        "includes a restart of the other end (the station's process; the autopilot on the ground, the companion's "
        "process in the air). The mission says on_link_loss: hold and on_pose_lost: continue. Each long loss is "
        "noticed and shown, and the policy acts on it. Once the link is back and the operator resumes, the mission "
        "finishes, and the vehicle lands and disarms. Then the pre-flight list has nothing red, no policy is left "
        "over, and the same mission flies again.",
        matrix,
        seeds="1",
    ),
)
