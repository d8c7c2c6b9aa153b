"""Libraries are loaded by one thread at a time."""

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest

from gloc3.loading import load_modules

SLOW = "import time\nevents.append('in')\ntime.sleep(0.1)\nevents.append('out')\n"
NAMES = ("slow_one", "slow_two", "slow_three")


def test_threads_load_one_after_the_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    events: list[str] = []
    monkeypatch.setattr(sys, "load_events", events, raising=False)
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in NAMES:
        (tmp_path / f"{name}.py").write_text(f"import sys\nevents = sys.load_events\n{SLOW}")
    together = Barrier(len(NAMES))

    def load(name: str) -> None:
        together.wait()
        load_modules(name)

    with ThreadPoolExecutor(len(NAMES)) as threads:
        list(threads.map(load, NAMES))
    for name in NAMES:
        assert sys.modules.pop(name).events is events
    assert events == ["in", "out"] * len(NAMES)


def test_a_module_that_is_not_there_is_an_import_error_and_frees_the_others() -> None:
    with pytest.raises(ModuleNotFoundError, match="no_such_library"):
        load_modules("no_such_library")
    with ThreadPoolExecutor(1) as thread:
        thread.submit(load_modules, "json").result(10.0)
