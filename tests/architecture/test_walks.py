"""The page of walks: it lists what a flight passes today, and no walk becomes longer."""

import pytest
from tests.house.walks import PAGE, WALKS, WITH_SCREEN, Function, files_on, functions_on, listed, stacks_of

pytestmark = pytest.mark.flight

LONGER = {"mission": 21}
"""Files of a walk that is over its bar: it may only get fewer. A mission crosses the link, which is nine files, is checked on
both sides by the same two, and starts through executor, flow, board and items, which are 1,505 lines. Any three of them in
others would be files of two ideas, or over 500 lines."""


def on_the_page(name: str) -> list[Function]:
    return listed(PAGE.read_text(encoding="utf-8"))[WALKS[name].title]


@pytest.mark.parametrize("name", [name for name in WALKS if name not in WITH_SCREEN])
def test_the_page_lists_what_a_flight_passes(name: str) -> None:
    assert functions_on(stacks_of(name)) == on_the_page(name)


@pytest.mark.parametrize("name", WITH_SCREEN)
def test_a_walk_with_a_screen_passes_all_its_milestones(name: str) -> None:
    assert len(stacks_of(name)) == len(WALKS[name].milestones)  # its threads are real: what lies between may vary


@pytest.mark.parametrize("name", [name for name, walk in WALKS.items() if walk.most_files is not None])
def test_no_walk_passes_more_files_than_it_may(name: str) -> None:
    most = LONGER.get(name, WALKS[name].most_files)
    assert most is not None
    assert len(files_on(on_the_page(name))) <= most
