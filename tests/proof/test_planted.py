"""The planted mistakes of the page `planted` have their places still, and break an invariant that there is."""

import pytest
from tests.evidence import planted

from gloc3_sitl.proof.standard_invariants import STANDARD

pytestmark = pytest.mark.thorough  # searches all sources


def test_every_mistake_has_one_place_and_an_invariant() -> None:
    assert not planted.problems()
    assert {one.breaks for one in planted.mistakes()} <= {kind.name for kind in STANDARD}


def test_there_are_enough_of_them_and_none_twice() -> None:
    found = [(one.old, one.new) for one in planted.mistakes()]
    assert len(found) == len(set(found)) >= planted.AT_LEAST
