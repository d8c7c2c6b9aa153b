"""Reads platform files: found by path or by the name of an installed one, checked, every finding with its place."""

from collections.abc import Callable, Collection
from itertools import starmap
from pathlib import Path
from typing import Final, NamedTuple

from gloc3.documents import schema
from gloc3.documents.document import Document, dump_rows, load_bytes, parse
from gloc3.documents.format_version import check_format
from gloc3.errors import Finding, InputError, NotFound, nearest
from gloc3.platform.bases import completed, installed_platforms, platform_files
from gloc3.platform.check import findings_of
from gloc3.platform.platform import Platform

MOST_LOADED: Final = 64
"""Platforms that are remembered."""


def load_platform(
    name: str,
    *,
    is_loading_classes: bool = False,
    devices: Collection[str] | None = None,
    warn: Callable[[Finding], None] | None = None,
) -> Platform:
    """Reads a platform by path, or by the name of one that an installed package brings; see `read_platform`.

    While its files keep their content, further calls return the same platform.

    Raises:
        InputError: with everything that is wrong in it.
    """
    path = find_platform(name)
    if warn is not None:
        for finding in namesakes(name):
            warn(finding)
    known = _Loading(str(path), is_loading_classes, None if devices is None else tuple(devices))
    data, loaded = load_bytes(path), _loaded.get(known)
    if loaded is None or loaded.data != data or not all(starmap(_is_unchanged, loaded.bases.items())):
        loaded = _load(known, data)
        if len(_loaded) >= MOST_LOADED:
            _loaded.clear()
        _loaded[known] = loaded
    if warn is not None:
        for finding in loaded.warnings:
            warn(finding)
    return loaded.platform


class _Loading(NamedTuple):
    """A file to load, and what it is checked against."""

    file: str
    is_loading_classes: bool
    devices: tuple[str, ...] | None


class _Loaded(NamedTuple):
    platform: Platform
    warnings: list[Finding]
    data: bytes
    """Content of the file."""
    bases: dict[Path, bytes]
    """Content of the files that it extends."""


_loaded: Final[dict[_Loading, _Loaded]] = {}
"""Platforms that this process has loaded: a flight loads the same one several times."""


def _load(known: _Loading, data: bytes) -> _Loaded:
    document = read_document(data, known.file)
    warnings: list[Finding] = []
    platform = check_platform(
        document, is_loading_classes=known.is_loading_classes, devices=known.devices, warn=warnings.append
    )
    return _Loaded(platform, warnings, data, {file: load_bytes(file) for file in document.bases})


def _is_unchanged(file: Path, content: bytes) -> bool:
    try:
        return load_bytes(file) == content
    except InputError:
        return False


def namesakes(name: str) -> list[Finding]:
    """Other files of the name by which an installed platform was asked for: beside the reader, and in other packages."""
    used = platform_files().get(name)
    if used is None or Path(name).is_file():
        return []
    others = [Path(f"./{name}.yaml"), *installed_platforms(name)]
    message, hint = f"is not used: {used} is installed under this name, too", "give the file's path to use it"
    return [
        Finding(file=str(other), message=message, hint=hint, is_warning=True)
        for other in others
        if other.is_file() and not other.samefile(used)
    ]


def named_platform(reference: str | None) -> str:
    """The name of the platform that a mission's header stands for, by a name or a file.

    Args:
        reference: name of an installed file or of a platform that is not installed here, or a file; None without one.

    Returns:
        Empty without a reference, and for a file that is not here or has mistakes.
    """
    try:
        return "" if reference is None else load_platform(reference).platform
    except InputError:
        return "" if Path(str(reference)).suffix else str(reference)


def find_platform(name: str) -> Path:
    """Finds the file of a platform; plain names are searched in the folders of the entry points `gloc3.platforms`.

    Raises:
        NotFound: there is no platform of that name.
    """
    path, known = Path(name), platform_files()
    if path.is_dir() and name not in known:
        raise NotFound([Finding(file=name, message="is a folder, not a platform file")])
    if path.suffix or path.is_file():
        return path
    if name not in known:
        raise NotFound([Finding(file=name, message="no such platform", hint=nearest(name, sorted(known)))])
    return known[name]


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
        file: its name in findings.
        is_loading_classes: whether the components' classes are imported, and ports, topics and settings checked against
            them.
        devices: with the classes: patterns of the devices that the host has; None does not check them.
        warn: called with warnings about a usable file.

    Raises:
        InputError: lists all errors in it.
    """
    return check_platform(read_document(data, file), is_loading_classes=is_loading_classes, devices=devices, warn=warn)


def read_document(data: bytes | str, file: str) -> Document:
    """The complete platform document of a file, including its bases, before it is checked.

    Raises:
        InputError: it is not valid YAML, or a base cannot be used.
    """
    written = parse(data, file)
    check_format(written)
    return completed(written)


def whole_text(name: str) -> str:
    """Self-contained text of a platform, by path or installed name: as written, or with all its bases merged.

    Raises:
        InputError: the file cannot be read, is not valid YAML, or a base cannot be used.
    """
    path = find_platform(name)
    data = load_bytes(path)
    written = parse(data, str(path))
    whole = completed(written)
    return data.decode("utf-8-sig") if whole is written else dump_rows(whole.value)


def files_of(path: Path) -> list[Path]:
    """A platform's file and all that it extends.

    Raises:
        InputError: one cannot be read.
    """
    return [path, *sorted(read_document(load_bytes(path), str(path)).bases)]


def check_platform(
    document: Document,
    *,
    is_loading_classes: bool = False,
    devices: Collection[str] | None = None,
    warn: Callable[[Finding], None] | None = None,
) -> Platform:
    """The platform of a whole document; see `read_platform`.

    Raises:
        InputError: with everything that is wrong in it.
    """
    check_format(document)
    findings: list[Finding] = []
    platform = schema.check(document.root, Platform, document.file, findings)
    if platform is not None:
        findings += findings_of(platform, document, is_loading_classes=is_loading_classes, devices=devices)
    if platform is None or any(not finding.is_warning for finding in findings):
        raise InputError(sorted(findings))
    if warn is not None:
        for finding in sorted(findings):
            warn(finding)
    return platform
