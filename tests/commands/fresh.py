"""A virtual environment as a stranger has it: GLOC3 from its wheel. What it requires is the tests' own: nothing is fetched."""

import fcntl
import os
import subprocess
import sys
import sysconfig
from collections.abc import Mapping
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
SCRIPTS: Final = {"gloc3": "gloc3.cli.start", "pip": "pip._internal.cli.main"}
"""Programs of the environment, with the modules whose `main` they call."""


def unpacked_wheel(shared: Path) -> Path:
    """The wheel of the tree, installed in a folder; once for all processes of a run of the tests.

    Args:
        shared: a folder that these processes share.
    """
    site = shared / "wheel-site"
    with (shared / "wheel.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not site.exists():
            new = shared / "wheel-new"
            _run("hatchling", "build", "-t", "wheel", "-d", str(shared / "wheel"))
            (wheel,) = (shared / "wheel").glob("*.whl")
            _run("pip", "install", "--no-index", "--no-deps", "--no-compile", "--target", str(new), str(wheel))
            new.rename(site)
    return site


def fresh_environment(folder: Path, site: Path) -> Mapping[str, str]:
    """A new virtual environment; returns the variables with which its programs are run.

    Args:
        folder: where it is made.
        site: the installed wheel.
    """
    _run("venv", "--without-pip", str(folder))
    python = folder / "bin" / "python"
    own = subprocess.run(
        [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"],
        check=True,
        capture_output=True,
        text=True,
    )
    Path(own.stdout.strip(), "stranger.pth").write_text(f"{site}\n{sysconfig.get_path('purelib')}\n", encoding="utf-8")
    for name, module in SCRIPTS.items():
        script = folder / "bin" / name
        script.write_text(f"#!{python}\nimport sys\nfrom {module} import main\nsys.exit(main())\n", encoding="utf-8")
        script.chmod(0o755)
    without = ("PYTHONPATH", "PYTHONDONTWRITEBYTECODE", "VIRTUAL_ENV")
    variables = {name: value for name, value in os.environ.items() if name not in without}
    return variables | {
        "PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "PIP_NO_INDEX": "1",
        "PIP_NO_BUILD_ISOLATION": "0",  # by pip's reading, the value of the option's opposite
        "PIP_DISABLE_PIP_VERSION_CHECK": "1",
    }


def _run(module: str, *arguments: str) -> None:
    subprocess.run([sys.executable, "-m", module, *arguments], cwd=ROOT, check=True, capture_output=True)
