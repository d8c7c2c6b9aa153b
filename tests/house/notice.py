"""`NOTICE`: the licences of the packages that an installation of GLOC3 can bring, from their own metadata."""

import re
import tomllib
from collections.abc import Iterator, Mapping
from importlib.metadata import metadata
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
FILE: Final = ROOT / "NOTICE"
HEAD: Final = """\
GLOC3
Copyright (c) 2026 The GLOC3 authors. MIT licence, see LICENSE.

GLOC3 contains no code of the packages below. Its installation fetches them, by the extra that is named, and each remains
under its own licence, as its metadata states it. Packages may contain further libraries: their licence files name them.
`make docs` writes this file, and a test compares it.
"""
UNLOCKED: Final[Mapping[str, str]] = {"depthai": "MIT"}
"""Declared packages that are not in the lock, and so need not be installed here, with the licence that they state."""
OF_A_CLASSIFIER: Final = "License :: "


def declared() -> dict[str, str]:
    """The declared packages, and the extra that brings each; empty for those that are always installed."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras: Mapping[str, list[str]] = {"": project["dependencies"], **project["optional-dependencies"]}
    return {re.split(r"[^\w.-]", one, maxsplit=1)[0]: extra for extra, all_of in extras.items() for one in all_of}


def licence_of(package: str) -> str:
    """The licence of an installed package: its expression, its classifiers, or the first line of its licence.

    Raises:
        ValueError: Its metadata names none.
    """
    if package in UNLOCKED:
        return UNLOCKED[package]
    given = metadata(package)
    classifiers = [
        one.removeprefix(OF_A_CLASSIFIER).removeprefix("OSI Approved :: ")
        for one in given.get_all("Classifier", [])
        if one.startswith(OF_A_CLASSIFIER)
    ]
    lines = "\n".join(given.get_all("License", [])).splitlines()
    found = "".join(given.get_all("License-Expression", [])) or "; ".join(classifiers) or (lines[0] if lines else "")
    if not found:
        raise ValueError(f"the metadata of {package} name no licence: read its files, and say here what they say")
    return found


def _rows() -> Iterator[tuple[str, str, str]]:
    yield "package", "extra", "licence"
    for package, extra in sorted(declared().items(), key=lambda item: (item[1], item[0].lower())):
        yield package, extra or "-", licence_of(package)


def text() -> str:
    """The file for what is declared and installed."""
    rows = list(_rows())
    wide = [max(len(row[column]) for row in rows) for column in (0, 1)]
    return "\n".join([HEAD, *(f"{row[0]:{wide[0]}}  {row[1]:{wide[1]}}  {row[2]}" for row in rows), ""])
