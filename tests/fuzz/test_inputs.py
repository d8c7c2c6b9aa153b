"""Every input of the corpora, and every one that once broke a promise, goes through its target again."""

import tracemalloc
from pathlib import Path

import pytest
from tests.fuzz import target as targets
from tests.fuzz.target import CORPUS, FOUND, FuzzTarget, judge, keep, smaller
from tests.fuzz.targets import TARGETS

pytestmark = pytest.mark.thorough  # imports every parser

MOST_BYTES = 100_000_000
"""Memory that no input of at most 4 kB may need."""
INPUTS = [(target.name, path) for target in TARGETS.values() for path in target.inputs]


@pytest.mark.parametrize(("name", "path"), INPUTS, ids=[f"{name}-{path.name}" for name, path in INPUTS])
def test_an_input_keeps_the_promise_of_its_target(name: str, path: Path) -> None:
    TARGETS[name].run(path.read_bytes())


@pytest.mark.parametrize("name", TARGETS)
def test_no_input_of_a_target_needs_much_memory(name: str) -> None:
    for path in TARGETS[name].inputs:
        data = path.read_bytes()
        tracemalloc.start()
        try:
            TARGETS[name].run(data)
            assert tracemalloc.get_traced_memory()[1] < MOST_BYTES, path.name
        finally:
            tracemalloc.stop()


def test_every_target_has_a_claim_and_a_corpus_of_its_own() -> None:
    assert [target.name for target in TARGETS.values() if not target.claim.endswith(".")] == []
    for folder in (CORPUS, FOUND):
        assert {path.name for path in folder.iterdir()} <= set(TARGETS)
    assert {path.name for path in CORPUS.iterdir()} == set(TARGETS)


def planted(data: bytes) -> None:
    """Nothing is wrong with any bytes."""
    if b"bug" in data:
        raise KeyError("planted")


def test_a_broken_promise_is_found_made_smaller_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(targets, "FOUND", tmp_path)
    target = FuzzTarget("planted", "", planted, __name__, ())
    data = b"before" * 20 + b"bug" + b"behind" * 20
    broken = judge(target, data)
    assert broken is not None
    assert (broken.what, broken.where.partition(":")[0]) == ("KeyError", "test_inputs.py")
    small = smaller(target, data, broken)
    assert small == b"bug"
    kept = keep(target, small, broken)
    assert kept.parent == tmp_path / "planted"
    assert kept.read_bytes() == small
    assert judge(target, b"well") is None


def test_what_takes_too_long_or_too_much_breaks_the_promise(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(targets, "SLOW_S", -1.0)
    target = FuzzTarget("planted", "", planted, __name__, ())
    slow = judge(target, b"")
    assert slow is not None
    assert slow.what == "slow"
    monkeypatch.undo()
    monkeypatch.setattr(targets, "GREEDY_KB", -1)
    greedy = judge(target, b"")
    assert greedy is not None
    assert greedy.what == "greedy"
