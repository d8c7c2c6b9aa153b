"""`make fuzz [NAME=target] [SECONDS=60]`: fuzzes targets, one after another, and keeps what breaks a promise as a test."""

import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import msgspec
from tests.fuzz.target import CORPUS, FOUND, LARGEST, FuzzTarget
from tests.fuzz.targets import TARGETS

TREE: Final = Path(__file__).parents[2]
RUNS: Final = TREE / "runs" / "fuzz"
HANGS_S: Final = 60
"""An input that takes so long ends the run, and is kept."""
MOST_MB: Final = 4096
_EXECUTIONS: Final = re.compile(r"stat::number_of_executed_units: (\d+)")
_COVERED: Final = re.compile(r"cov: (\d+) ft: (\d+) corp: (\d+)")
_FINDING: Final = re.compile(r"^FOUND .*", re.MULTILINE)


class Fuzzed(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one run of one target."""

    executions: int
    edges: int
    """Branches of the target's code that were reached."""
    corpus: int
    """Inputs that reach something which the others do not."""
    findings: list[str]
    """One line for each broken promise."""


def fuzz(target: FuzzTarget, seconds: int, folder: Path = RUNS) -> Fuzzed:
    """Fuzzes one target in a process of its own; what it finds is written to `tests/fuzz/found`.

    Args:
        target: the target.
        seconds: of wall time.
        folder: for the inputs that it grows, from which the next run goes on, and its log.

    Raises:
        RuntimeError: the engine does not run; with the end of its log.
    """
    work = folder / target.name
    (work / "corpus").mkdir(parents=True, exist_ok=True)
    for stale in (work / "broken").glob("*"):
        stale.unlink()
    (work / "broken").mkdir(exist_ok=True)
    seeds = [str(place / target.name) for place in (CORPUS, FOUND) if (place / target.name).is_dir()]
    options = [f"-max_total_time={seconds}", f"-max_len={LARGEST}", f"-timeout={HANGS_S}", f"-rss_limit_mb={MOST_MB}"]
    options += ["-print_final_stats=1", f"-artifact_prefix={work / 'broken'}/", str(work / "corpus"), *seeds]
    called = [sys.executable, "-m", "tests.fuzz.engine", target.module, target.name, *target.code, "--", *options]
    log = work / "log.txt"
    with log.open("wb") as stream:
        code = subprocess.run(called, cwd=TREE, check=False, stdout=stream, stderr=stream).returncode
    text = log.read_text(encoding="utf-8", errors="replace")
    found = _FINDING.findall(text)
    for broken in (work / "broken").iterdir():  # the engine was ended by it: a hang, memory, or a crash below Python
        kept = FOUND / target.name / broken.name
        kept.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(broken, kept)
        found.append(f"FOUND {broken.name} ended the engine")
    executions, covered = _EXECUTIONS.findall(text), _COVERED.findall(text)
    if not covered or not (executions or found):
        raise RuntimeError(f"{target.name}: the engine ended with {code}:\n{text[-1500:]}")
    edges, _, corpus = map(int, covered[-1])
    done = int(executions[-1]) if executions else 0
    return Fuzzed(executions=done, edges=edges, corpus=corpus, findings=found)


def main(words: list[str]) -> int:
    """Runs the targets of these names, or all; 0 where no promise is broken."""
    seconds, names = int(words[0]), words[1:] or list(TARGETS)
    unknown = [name for name in names if name not in TARGETS]
    if unknown:
        print(f"no target {unknown[0]!r}; there are: {', '.join(TARGETS)}", file=sys.stderr)
        return 2
    if find_spec("atheris") is None:
        print("atheris is not installed: it has wheels for Linux on x86-64, Python 3.11 to 3.13", file=sys.stderr)
        return 2
    count = 0
    for name in names:
        result = fuzz(TARGETS[name], seconds)
        print(
            f"{name}: {result.executions} executions, {result.edges} edges, {len(result.findings)} findings", flush=True
        )
        for line in result.findings:
            print(f"  {line}", flush=True)
        count += len(result.findings)
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
