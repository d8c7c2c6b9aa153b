"""What the parts cost against the last commit that was measured: both in turn, so that the machine's moods cancel out.

Every run is added to `gloc3-bench.json` beside the sources, by commit. The file is of one machine, and is not in the
repository. The sources of the earlier commit are taken out of it, and measured by the benches of today.
"""

import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Final

import msgspec
from tests.benchmarks.sample import UNITS
from tests.evidence.house import unpack
from tests.house.measure import PACKAGES

from gloc3.clock import utc_now

ROOT: Final = Path(__file__).parents[2]
FILE: Final = ROOT / "gloc3-bench.json"
PAIRS: Final = 5
Sample = Mapping[str, float]
"""Figure to its value."""
Sampler = Callable[[Path], Sample]
"""Measures the sources of a tree once."""


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """One run of `make bench`."""

    commit: str
    is_changed: bool
    """Whether files differed from the commit's."""
    time: str
    python: str
    machine: str
    samples: list[dict[str, float]]
    against: str = ""
    """The commit that it was compared with; empty for none."""
    samples_against: list[dict[str, float]] = []
    """That one's, each taken beside the sample of the same place."""


class Ratio(msgspec.Struct, frozen=True):
    """A figure now as a share of what it was before, over all pairs; below 1 is less."""

    least: float
    middle: float
    most: float


def ratios(now: Sequence[Sample], before: Sequence[Sample]) -> dict[str, Ratio]:
    """The ratio of each figure that both have, pair by pair."""
    found = {}
    for name in now[0]:
        values = sorted(
            after[name] / earlier[name]
            for after, earlier in zip(now, before, strict=True)
            if name in after and earlier.get(name)
        )
        if values:
            found[name] = Ratio(values[0], median(values), values[-1])
    return found


def read(file: Path = FILE) -> list[Run]:
    """The runs so far, oldest first.

    Raises:
        SystemExit: the file is no history; it says what to do.
    """
    try:
        return msgspec.json.decode(file.read_bytes(), type=list[Run])
    except FileNotFoundError:
        return []
    except msgspec.DecodeError as error:
        raise SystemExit(f"{file} is no history of benchmarks ({error}); move it away") from error


def add(run: Run, file: Path = FILE) -> None:
    """Adds a run; the file is whole at any moment."""
    runs = msgspec.json.format(msgspec.json.encode([*read(file), run]), indent=1)
    fresh = file.with_suffix(".new")
    fresh.write_bytes(runs + b"\n")
    fresh.replace(file)


def take_samples(
    now: Path, before: Path | None, sampler: Sampler, pairs: int
) -> tuple[list[dict[str, float]], list[dict[str, float]]]:
    """Measures both trees in turn, so many times; the one that goes first changes each time."""
    trees = [now] if before is None else [now, before]
    taken: dict[Path, list[dict[str, float]]] = {tree: [] for tree in trees}
    for _ in range(pairs):
        for tree in trees:
            taken[tree].append(dict(sampler(tree)))
        trees.reverse()
    return taken[now], [] if before is None else taken[before]


def sample_of(tree: Path, *names: str) -> Sample:
    """Measures the sources of a tree in a process of its own: these figures, or all."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(str(tree / folder) for folder in PACKAGES.values())}
    command = [sys.executable, "-m", "tests.benchmarks.sample", *names]
    ended = subprocess.run(command, cwd=ROOT, env=environment, check=True, stdout=subprocess.PIPE)
    return msgspec.json.decode(ended.stdout, type=dict[str, float])


@contextmanager
def sources_of(commit: str) -> Iterator[Path]:
    """The tree of a commit in a folder of its own, its sources compiled as these are, for the duration of the block."""
    with tempfile.TemporaryDirectory() as folder:
        unpack(commit, Path(folder))
        packages = [str(Path(folder) / name) for name in PACKAGES.values()]
        subprocess.run([sys.executable, "-m", "compileall", "-q", *packages], check=True)
        yield Path(folder)


def table(run: Run) -> list[str]:
    """The figures of a run, and their ratios to those of the earlier commit."""
    compared = ratios(run.samples, run.samples_against) if run.against else {}
    lines = []
    for name in run.samples[0]:
        value = median(sample[name] for sample in run.samples)
        ratio = compared.get(name)
        spread = "" if ratio is None else f"   x {ratio.middle:.3f}  ({ratio.least:.3f} to {ratio.most:.3f})"
        lines.append(f"{name:<48} {value:8.2f} {UNITS.get(name, ''):<2}{spread}")
    return lines


def run(pairs: int = PAIRS) -> list[str]:
    """Measures these sources beside those of the last run's commit, and adds both to the history."""
    commit = _git("rev-parse", "--short=8", "HEAD")
    is_changed = bool(_git("status", "--porcelain", "--untracked-files=no", "--", *PACKAGES.values()))
    measured = [
        *([commit] if is_changed else []),
        *(past.commit for past in read() if is_changed or past.commit != commit),
    ]
    against, trouble = next((past for past in reversed(measured) if _is_known(past)), ""), ""
    if against:
        try:
            with sources_of(against) as before:
                samples, samples_against = take_samples(ROOT, before, sample_of, pairs)
        except subprocess.CalledProcessError as error:
            trouble, against = f"{against} cannot be measured by the benches of today: {error}", ""
    if not against:
        samples, samples_against = take_samples(ROOT, None, sample_of, pairs)
    this = Run(
        commit=commit,
        is_changed=is_changed,
        time=utc_now().isoformat(timespec="seconds"),
        python=platform.python_version(),
        machine=f"{platform.machine()}, {os.cpu_count()} processors",
        samples=samples,
        against=against,
        samples_against=samples_against,
    )
    add(this)
    head = f"x: share of {against}, median of {pairs} pairs (least to most); below 1 is less" if against else trouble
    return [*filter(None, [head]), *table(this), f"run {len(read())} in {FILE.name}"]


def _is_known(commit: str) -> bool:
    """Whether the repository still has a commit."""
    asked = ["git", "cat-file", "-e", f"{commit}^{{commit}}"]
    return subprocess.run(asked, cwd=ROOT, check=False, stderr=subprocess.DEVNULL).returncode == 0


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()
