"""The history that `make bench` keeps, and how it compares two trees."""

import subprocess
from pathlib import Path

import pytest
from tests.benchmarks.history import PAIRS, Ratio, Run, Sample, add, ratios, read, sample_of, table, take_samples
from tests.benchmarks.sample import LOOP, UNITS

ROOT = Path(__file__).parents[2]
CYCLE = "a hosted cycle with one output"


def run_of(commit: str, *samples: float, before: tuple[float, ...] = ()) -> Run:
    return Run(
        commit=commit,
        is_changed=False,
        time="2026-01-01T00:00:00+00:00",
        python="3.11",
        machine="any",
        samples=[{CYCLE: value} for value in samples],
        against="0123abcd" if before else "",
        samples_against=[{CYCLE: value} for value in before],
    )


def test_runs_are_kept_by_commit_and_what_is_no_history_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "history.json"
    assert read(file) == []
    first, second = run_of("aaaaaaaa", 4.0), run_of("bbbbbbbb", 2.0, before=(4.0,))
    add(first, file)
    add(second, file)
    assert read(file) == [first, second]
    assert [left.name for left in tmp_path.iterdir()] == [file.name]
    file.write_text("[{")
    with pytest.raises(SystemExit, match=r"is no history of benchmarks .* move it away"):
        read(file)


def test_ratios_are_of_pairs_and_show_their_spread() -> None:
    now = [{CYCLE: 2.0}, {CYCLE: 30.0}, {CYCLE: 4.5}]
    before = [{CYCLE: 4.0}, {CYCLE: 40.0}, {CYCLE: 5.0}]
    assert ratios(now, before) == {CYCLE: Ratio(0.5, 0.75, 0.9)}, "a moment that slows both changes no ratio"
    assert ratios([{CYCLE: 1.0, "new": 1.0}], [{CYCLE: 1.0}]) == {CYCLE: Ratio(1.0, 1.0, 1.0)}
    (line,) = table(run_of("aaaaaaaa", 2.0, 30.0, 4.5, before=(4.0, 40.0, 5.0)))
    assert line.split() == [*CYCLE.split(), "4.50", "us", "x", "0.750", "(0.500", "to", "0.900)"]
    (line,) = table(run_of("aaaaaaaa", 2.0))
    assert line.split() == [*CYCLE.split(), "2.00", "us"]


def test_the_trees_take_turns_in_going_first() -> None:
    asked: list[str] = []

    def sampler(tree: Path) -> Sample:
        asked.append(tree.name)
        return {CYCLE: float(len(asked))}

    now, before = take_samples(Path("now"), Path("before"), sampler, PAIRS)
    assert asked[:4] == ["now", "before", "before", "now"]
    assert (len(now), len(before)) == (PAIRS, PAIRS)
    alone, nothing = take_samples(Path("now"), None, sampler, 1)
    assert (len(alone), nothing) == (1, [])


def test_a_tree_is_measured_by_its_own_sources(tmp_path: Path) -> None:
    figures = sample_of(ROOT, LOOP, "local delivery to 2 subscribers")
    assert list(figures) == [LOOP, "local delivery to 2 subscribers"]
    assert set(figures) < set(UNITS)
    assert all(value > 0.0 for value in figures.values())
    (tmp_path / "common" / "gloc3").mkdir(parents=True)
    (tmp_path / "common" / "gloc3" / "__init__.py").write_text('raise SystemExit("these sources")')
    with pytest.raises(subprocess.CalledProcessError):
        sample_of(tmp_path, LOOP)
