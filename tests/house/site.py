"""Hooks of mkdocs: the pages at the top of the repository are part of the site, the README as its first page."""

import re
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT: Final = Path(__file__).parents[2]
TOP: Final = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "CONTRIBUTING.md",
    "CHANGELOG.md": "CHANGELOG.md",
    "SECURITY.md": "SECURITY.md",
    "CODE_OF_CONDUCT.md": "CODE_OF_CONDUCT.md",
    "LICENSE": "LICENSE.txt",
    "NOTICE": "NOTICE.txt",
}
"""Files of the repository's top, and their places in the site."""
_LINK: Final = re.compile(r"(?<=\]\()([^)#\s]+)")


def on_files(files: "Files", config: "MkDocsConfig") -> "Files":
    """Adds the files of the top."""
    from mkdocs.structure.files import File

    for name, place in TOP.items():
        files.append(File.generated(config, place, content=(ROOT / name).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: "Page", config: "MkDocsConfig", files: "Files") -> str:
    """Rewrites links between the top and `docs`, which are one folder in the site."""
    uri = page.file.src_uri
    is_top = uri in TOP.values()
    folder = PurePosixPath() if is_top else PurePosixPath("docs", uri).parent

    def placed(match: re.Match[str]) -> str:
        return site_link(match[1], folder)

    return _LINK.sub(placed, markdown)


def site_link(target: str, folder: PurePosixPath) -> str:
    """A link of a page in a folder of the repository, as the same link in the site.

    Args:
        target: Path relative to the page, or an address.
        folder: The page's folder, relative to the repository's top.
    """
    if "://" in target:
        return target
    path = (ROOT / folder / target).resolve().relative_to(ROOT).as_posix()
    inside = TOP.get(path) or (path.removeprefix("docs/") if path.startswith("docs/") else None)
    if inside is None:
        return target
    up = "../" * (len(folder.parts) - 1)
    return f"{up}{inside}"


def anchor_of(heading: str) -> str:
    """The name by which a heading is reached, on GitHub and in the site."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
