"""The package that a page of the documentation writes, made known as `pip install --editable .` does, in its folder alone."""

import tomllib
from pathlib import Path


def install(pyproject: str, folder: Path) -> None:
    """Writes what an installer writes of the entry points.

    Args:
        pyproject: the text of `pyproject.toml`.
        folder: where the package is, which has to be on the path.
    """
    project = tomllib.loads(pyproject)["project"]
    info = folder / f"{project['name']}-{project['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    groups = [
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in points.items())
        for group, points in project["entry-points"].items()
    ]
    (info / "entry_points.txt").write_text("\n".join(groups))
