"""Phrases of documents and help that have a plainer form."""

import ast
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

from tests.house.measure import read_modules

ROOT: Final = Path(__file__).parents[2]
RIDDLES: Final = re.compile(
    r"\b(?:anew|whoever|befalls?|hearsay|lament\w*|heralds?|confess\w*|caretakers?|errands?|for lost|brings nothing"
    r"|until somebody|there and back|speaks against|(?:said|told|put) in words|the one at hand|what it is worth"
    r"|(?:is|are|was|were|be|been) told|lets? (?:you|it|them) know|looks old|comes to nothing|to no avail)\b",
    re.IGNORECASE,
)
"""Phrases of documents and help that have a plainer form: *again*, *if*, *reported*, *shown*, *reasons*."""
PAGES: Final = (
    *sorted(ROOT.glob("*.md")),
    *sorted(page for page in (ROOT / "docs").rglob("*.md") if page.parent.name != "evidence"),
)
"""What people read; of `docs/evidence` the claims are checked where they are written."""
_QUOTED: Final = re.compile(r"```.*?```|`[^`\n]*`", re.DOTALL)


def riddles_in(text: str) -> list[str]:
    """Lines of a page or a docstring with a phrase that has a plainer form, quoted code aside."""
    plain = _QUOTED.sub("", text)
    return [plain[: found.start()].rpartition("\n")[2] + found[0] for found in RIDDLES.finditer(plain)]


def help_texts() -> Iterator[tuple[str, str]]:
    """Texts of the modules behind the commands, from which their help is made, with the module's path."""
    for module in read_modules(ROOT).values():
        if "cli" in module.path.with_suffix("").parts:
            for node in module.nodes:
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield str(module.path), node.value


def texts() -> Iterator[tuple[str, str]]:
    """Pages and texts behind the help of the commands, with where they are."""
    yield from ((str(page.relative_to(ROOT)), page.read_text(encoding="utf-8")) for page in PAGES)
    yield from help_texts()


def findings(read: Iterable[tuple[str, str]]) -> Iterator[tuple[str, str]]:
    """The phrases that have a plainer form, with where they are."""
    return ((where, phrase) for where, text in read for phrase in riddles_in(text))
