"""A fuzz target: a function that hands bytes of a stranger to a parser, and what must hold of it."""

import atexit
import resource
import sys
import time
from collections.abc import Callable, Iterator
from hashlib import sha256
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from traceback import extract_tb
from typing import Final, NamedTuple

from gloc3.component.workers import guard
from gloc3.errors import InputError, Refused

ROOT: Final = Path(__file__).parent
CORPUS, FOUND = ROOT / "corpus", ROOT / "found"
"""Inputs that reach something, by target; and those that once broke one."""
SLOW_S: Final = 2.0
"""Processor time that no input may take; the largest has `LARGEST` bytes."""
LARGEST: Final = 4096
GREEDY_KB: Final = 200_000
"""By so much memory an input may not raise the peak of the process."""

Run = Callable[[bytes], None]


class FuzzTarget(NamedTuple):
    """One parser and its promise."""

    name: str
    claim: str
    """What must hold for any bytes."""
    run: Run
    """Raises whatever breaks the promise."""
    module: str
    code: tuple[str, ...]
    """Packages whose coverage guides the search."""

    @property
    def inputs(self) -> list[Path]:
        """The inputs in the tree: corpus and findings."""
        return [path for folder in (CORPUS, FOUND) for path in sorted((folder / self.name).glob("*"))]


TARGETS: Final[dict[str, FuzzTarget]] = {}
"""All targets whose modules are imported."""


def fuzz_target(*code: str) -> Callable[[Run], Run]:
    """Makes a function a target; its name and its docstring are the target's."""

    def add(run: Run) -> Run:
        name = run.__name__.replace("_", "-")
        claim = " ".join((run.__doc__ or "").split())
        TARGETS[name] = FuzzTarget(name, claim, run, run.__module__, code)
        return run

    return add


class Broken(NamedTuple):
    """A promise that an input breaks."""

    what: str
    """The error's class, `slow` or `greedy`."""
    where: str
    """The innermost line of it; empty where there is none."""
    text: str


def judge(target: FuzzTarget, data: bytes) -> Broken | None:
    """Runs a target on an input; None where its promise holds."""
    begin_s, begin_kb = time.thread_time(), _peak_kb()
    _, error = guard(target.run, data)
    took_s, more_kb = time.thread_time() - begin_s, _peak_kb() - begin_kb
    if error is not None:
        place = extract_tb(error.__traceback__)[-1]
        text = str(error).partition("\n")[0][:200]
        return Broken(type(error).__name__, f"{Path(place.filename).name}:{place.lineno}", text)
    if took_s > SLOW_S:
        return Broken("slow", "", f"{took_s:.1f} s of processor time")
    if more_kb > GREEDY_KB:
        return Broken("greedy", "", f"{more_kb // 1000} MB more memory")
    return None


def _peak_kb() -> int:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak // 1024 if sys.platform == "darwin" else peak


def smaller(target: FuzzTarget, data: bytes, broken: Broken, tries: int = 400) -> bytes:
    """Cuts pieces out of an input as long as it breaks the same promise at the same place."""
    size = len(data) // 2
    while size and tries > 0:
        place = 0
        while place < len(data) and tries > 0:
            shorter, tries = data[:place] + data[place + size :], tries - 1
            found = judge(target, shorter)
            if found is not None and found[:2] == broken[:2]:
                data = shorter
            else:
                place += size
        size //= 2
    return data


def keep(target: FuzzTarget, data: bytes, broken: Broken) -> Path:
    """Writes a finding into the tree, where every run of the tests meets it again."""
    folder = FOUND / target.name
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{broken.what}-{sha256(data).hexdigest()[:8]}"
    path.write_bytes(data)
    return path


# --- for targets ---


def refuses(call: Callable[[], object], *declared: type[Exception]) -> bool:
    """Has a reader read, and returns whether it refused.

    It may do so with findings that each have a place, with a `Refused`, or with another declared error, and says why.
    """
    _, error = guard(call)
    if error is None:
        return False
    if not isinstance(error, (InputError, Refused, *declared)):
        raise error
    assert str(error)
    for finding in error.findings if isinstance(error, InputError) else ():
        assert finding.file
        assert finding.message
        assert min(finding.line, finding.column) >= 0
    return True


_SCRATCH: Final = mkdtemp(prefix="gloc3-fuzz-")
atexit.register(rmtree, _SCRATCH, ignore_errors=True)


def as_file(data: bytes, name: str = "file") -> Path:
    """The bytes as a file, the same one each time."""
    path = Path(_SCRATCH, name)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


PART: Final = b"\n-- 8< --\n"
"""Separates the files of an input that stands for a folder."""


def as_folder(data: bytes, *names: str) -> Path:
    """The parts of the bytes as files of these names; those without a part are empty."""
    folder = Path(_SCRATCH, "folder")
    for name, part in zip(names, [*data.split(PART), *[b""] * len(names)], strict=False):
        as_file(part, f"folder/{name}")
    return folder


def pieces(data: bytes, size: int) -> Iterator[bytes]:
    """The bytes in pieces of a size."""
    for place in range(0, len(data), size):
        yield data[place : place + size]
