"""The missions that ship with GLOC3 and go by name."""

from pathlib import Path

from gloc3.errors import Finding, NotFound, nearest


def example_missions() -> dict[str, Path]:
    """Their files by name."""
    return {path.stem: path for path in sorted(Path(__file__).parent.glob("*.yaml"))}


def find_mission(name: str) -> Path:
    """The file of a mission: a path, or the name of an example.

    Raises:
        NotFound: there is none of that name.
    """
    path, known = Path(name), example_missions()
    if name in known and not path.is_file():
        return known[name]
    if path.is_dir():
        raise NotFound([Finding(file=name, message="is a folder, not a mission file")])
    if path.suffix or path.is_file():
        return path
    raise NotFound([Finding(file=name, message="no such mission", hint=nearest(name, list(known)))])
