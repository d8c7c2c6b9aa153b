"""The workers of a search end with it, also when it is killed."""

import select
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
from gloc3_sitl.proof.case import FlightCase
from gloc3_sitl.proof.search import flying
if __name__ == "__main__":
    with flying(2) as fly:
        cases = [FlightCase(mission="nowhere", platform="pelican_rtk")] * 2
        try:
            list(fly(cases, ()))
        except Exception:
            pass
        print("flown", flush=True)
        input()
"""


@pytest.mark.sockets
def test_workers_of_a_killed_search_end(tmp_path: Path) -> None:
    (tmp_path / "search.py").write_text(PROGRAM)
    with subprocess.Popen([sys.executable, str(tmp_path / "search.py")], stdin=-1, stdout=-1, text=True) as search:
        assert search.stdout is not None
        assert search.stdout.readline() == "flown\n"
        search.kill()
        has_ended, _, _ = select.select([search.stdout], [], [], 20.0)
        assert has_ended, "its workers hold its stdout open"
        assert search.stdout.read() == ""
