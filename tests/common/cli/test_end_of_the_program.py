"""The end of the program: nothing is collected in it, where msgspec may crash (its issue 717)."""

import subprocess
import sys

import pytest

CODE = """
import atexit, gc, sys
atexit.register(lambda: print("kept:", gc.get_freeze_count() > 1000))
from gloc3.cli.start import main
sys.argv = ["gloc3", *{arguments}]
main()
"""


@pytest.mark.parametrize("arguments", [["--version"], ["mission", "check", "hop", "--platform", "pelican_rtk"]])
def test_what_lives_at_the_end_is_not_collected(arguments: list[str]) -> None:
    command = [sys.executable, "-c", CODE.format(arguments=arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "kept: True"
