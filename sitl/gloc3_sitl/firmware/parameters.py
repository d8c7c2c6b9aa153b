"""Parameter files for the firmwares: what makes a vehicle of ours fly with them."""

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

from gloc3.errors import Refused

_FOLDER = "presets"


def preset_text(name: str) -> str:
    """The parameter file of that name.

    Raises:
        Refused: there is none.
    """
    file = files("gloc3_sitl.firmware") / _FOLDER / name
    if not file.is_file():
        raise Refused(f"there is no parameter file {name} for this vehicle")
    return file.read_text()


def read_parameters(text: str, name: str = "") -> dict[str, float]:
    """Reads lines of NAME VALUE, or NAME,VALUE; what follows a # is a remark.

    Raises:
        Refused: a line has another form; with its number.
    """
    found: dict[str, float] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            key, value = words
            found[key] = float(value)
        except ValueError:
            raise Refused(f"{name}:{number}: {line.strip()!r} is not NAME VALUE") from None
    return found


def write_parameters(file: Path, parameters: Mapping[str, float]) -> None:
    """Writes lines of NAME VALUE."""
    file.write_text("".join(f"{name} {value:.10g}\n" for name, value in parameters.items()))
