"""How the documents, the help and the messages read: the style check, and sentences drawn at random, before and after."""

import re
from pathlib import Path
from typing import Final

import msgspec
from tests.evidence.page import Bar, Figure, Progress
from tests.house import sentences, style

KEPT: Final = Path(__file__).with_name("sentences.yaml")
"""The sentences as they were drawn, with what those that read like a translation have become."""
LEAST: Final = 60


class Drawn(msgspec.Struct, frozen=True):
    """A sentence that was drawn."""

    where: str
    before: str
    after: str = ""
    """Empty where it stays as it was."""

    @property
    def now(self) -> str:
        """The sentence as it is to be read today."""
        return self.after or self.before


class Sample(msgspec.Struct, frozen=True):
    """The sentences, and where they come from."""

    seed: int
    commit: str
    sentences: list[Drawn]


def kept() -> Sample:
    """The sample that was judged."""
    return msgspec.yaml.decode(KEPT.read_bytes(), type=Sample)


def standing(sample: Sample) -> list[Drawn]:
    """Those sentences that are found in their files as they are to be read."""
    texts: dict[str, str] = {}
    for kind, _ in sentences.KINDS:
        for each in kind():
            texts[each.where] = f"{texts.get(each.where, '')} {each.text}"
    return [drawn for drawn in sample.sentences if drawn.now in texts.get(drawn.where, "")]


def language(progress: Progress) -> list[Figure]:
    """The bar."""
    del progress
    read, sample = list(style.texts()), kept()
    found, there = list(style.findings(read)), standing(sample)
    count, changed = len(sample.sentences), [drawn for drawn in sample.sentences if drawn.after]
    return [
        Figure("pages, and texts behind the help, that the style check reads", f"{len(read):,}"),
        Figure("phrases in them that have a plainer form", str(len(found)), "0", not found),
        Figure(
            f"sentences drawn at `{sample.commit}` with seed {sample.seed}", str(count), f"≥ {LEAST}", count >= LEAST
        ),
        Figure("… of these written again", str(len(changed))),
        Figure("… that are found today as they stand below", str(len(there)), str(count), len(there) == count),
        *(
            Figure(f"`{drawn.where}`", f"{_cell(drawn.before)}{f' → *{_cell(drawn.after)}*' if drawn.after else ''}")
            for drawn in sample.sentences
        ),
    ]


def _cell(text: str) -> str:
    """A sentence in a cell of a table, links as their texts."""
    return re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text).replace("|", "\\|")


BARS: Final = (
    Bar(
        "language",
        "Documents, help and messages are plain English",
        "The style check searches README, docs and help for phrases that have a plainer form. Of the "
        "sentences in README and docs, in the help of the commands and in messages of errors, checks and findings, sixty were drawn "
        "with a seed and judged by hand; those that read like a translation were written again (behind the arrow). `…` stands for "
        "values in a message.",
        language,
        seeds="23",
    ),
)
