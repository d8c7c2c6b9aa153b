"""The small mistakes of the page `mutants` have their places still, and the tests that are to notice them are there."""

from tests.evidence import mutants


def test_every_mistake_has_one_place_and_one_test() -> None:
    assert not mutants.problems()


def test_there_are_enough_of_them_and_none_twice() -> None:
    found = [(mutant.promise, mutant.mistake) for mutant in mutants.mutants()]
    assert len(found) == len(set(found)) >= mutants.AT_LEAST
