"""Reads platform files: found by path or by the name of an installed one, checked, every finding with its place."""

from collections.abc import Callable, Collection
from pathlib import Path

from gloc3.documents import schema
from gloc3.documents.document import load_bytes, parse
from gloc3.errors import Finding, InputError, NotThere, nearest
from gloc3.installed import installed_points
from gloc3.platform.check import findings_of
from gloc3.platform.platform import Platform


def load_platform(
    name: str,
    *,
    is_loading_classes: bool = False,
    devices: Collection[str] | None = None,
    warn: Callable[[Finding], None] | None = None,
) -> Platform:
    """Reads a platform by path, or by the name of one that an installed package brings; see `read_platform`.

    Raises:
        InputError: with everything that is wrong in it.
    """
    path = find_platform(name)
    return read_platform(load_bytes(path), str(path), is_loading_classes=is_loading_classes, devices=devices, warn=warn)


def find_platform(name: str) -> Path:
    """The file of a platform; plain names are looked up in the folders of the entry points `gloc3.platforms`.

    Raises:
        NotThere: there is none of that name.
    """
    path, known = Path(name), platform_files()
    if path.is_dir() and name not in known:
        raise NotThere([Finding(file=name, message="is a folder, not a platform file")])
    if path.suffix or path.is_file():
        return path
    if name not in known:
        raise NotThere([Finding(file=name, message="no such platform", hint=nearest(name, sorted(known)))])
    return known[name]


def platform_files() -> dict[str, Path]:
    """The files of all platforms that installed packages bring, by the files' names."""
    known: dict[str, Path] = {}
    for point in installed_points("gloc3.platforms"):
        for folder in point.load().__path__:
            known.update({file.stem: file for file in sorted(Path(folder).glob("*.yaml"))})
    return known


def read_platform(
    data: bytes | str,
    file: str,
    *,
    is_loading_classes: bool = False,
    devices: Collection[str] | None = None,
    warn: Callable[[Finding], None] | None = None,
) -> Platform:
    """Reads and checks a platform file.

    Args:
        data: its content.
        file: what the findings call it.
        is_loading_classes: whether the components' classes are imported, and ports, topics and settings checked against
            them.
        devices: with the classes: patterns of the devices that the host has; None does not check them.
        warn: takes what is doubtful in a file that can be used.

    Raises:
        InputError: with everything that is wrong in it.
    """
    document = parse(data, file)
    findings: list[Finding] = []
    platform = schema.check(document.root, Platform, file, findings)
    if platform is not None:
        findings += findings_of(platform, document, is_loading_classes=is_loading_classes, devices=devices)
    if platform is None or any(not finding.is_warning for finding in findings):
        raise InputError(sorted(findings))
    if warn is not None:
        for finding in sorted(findings):
            warn(finding)
    return platform
