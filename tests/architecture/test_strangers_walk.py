"""The three tasks of a newcomer, in short: each step's section exists, and shows the command or gives the file."""

import pytest
from tests.evidence.page import INDEX, ROOT
from tests.evidence.strangers_walk import DOCS, GENERATED, OTHERS, TASKS, Step, section, taught
from tests.house.made import files

pytestmark = pytest.mark.thorough

STEPS = [(task.name, step) for task in TASKS for step in task.steps]


@pytest.mark.parametrize(("task", "step"), STEPS, ids=lambda each: each if isinstance(each, str) else each.shown)
def test_the_site_teaches_each_step_of_a_task(task: str, step: Step) -> None:
    given = taught(step)
    assert all(own in given for own in step.put.values()), "the reader's own names are in it"
    assert not any(example in given for example in step.put), "nothing of the example's is left"


@pytest.mark.parametrize(
    ("step", "reason"),
    [
        (Step("logs.md#why-did-it-fly", "gloc3 log why runs/today land", {}, "because"), "leads nowhere"),
        (Step("logs.md#in-foxglove", "gloc3 log why runs/today land", {}, "because"), "does not show"),
        (Step("tutorials/own-sensor.md#the-platform", "gas/co2.py"), "does not give"),
    ],
)
def test_a_step_that_nobody_teaches_is_found(step: Step, reason: str) -> None:
    with pytest.raises(LookupError, match=reason):
        taught(step)


def test_a_section_ends_where_the_next_of_its_rank_begins() -> None:
    text = section("logs.md#why-did-it-land")
    assert "gloc3 log why" in text
    assert "## " not in text


def test_every_file_that_is_made_from_the_code_is_compared_on_the_page() -> None:
    made = {*files(), *(DOCS / "schema").iterdir(), INDEX}
    assert set(GENERATED) == {path.relative_to(ROOT).as_posix() for path in made}


def test_the_tests_that_are_named_exist() -> None:
    assert all((ROOT / path).is_file() for path in (*GENERATED, *GENERATED.values(), *OTHERS.values()))
