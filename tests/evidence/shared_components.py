"""How many components the platforms share: counted from their platform files."""

from tests.evidence.page import Bar, Figure, Progress

from gloc3.platform.bases import platform_files
from gloc3.platform.reader import load_platform

ADAPTED = frozenset({"copter", "submarine"})
"""Platform files for vehicles of any make, which repeat what others have."""


def classes(platform: str) -> set[str]:
    """The classes of a platform's components, standbys counted once."""
    return {row.load_class().__name__ for row in load_platform(platform).components}


def shared_components(progress: Progress) -> list[Figure]:
    """One figure a platform: what it uses, and what nobody else does."""
    del progress
    names = [name for name in sorted(platform_files()) if name not in ADAPTED]
    used = {name: classes(name) for name in names}
    everywhere = set.intersection(*used.values())
    figures = [
        Figure("component classes in all of these platforms", f"{len(everywhere)}: {', '.join(sorted(everywhere))}")
    ]
    for name in names:
        others = set().union(*(used[other] for other in names if other != name))
        own = sorted(used[name] - others)
        figures.append(
            Figure(
                f"{name}: shared with another platform, of all its classes",
                f"{len(used[name]) - len(own)} of {len(used[name])}" + (f"; its own: {', '.join(own)}" if own else ""),
                "at least two thirds",
                3 * len(own) <= len(used[name]),
            )
        )
    return figures


BARS = (
    Bar(
        "shared-components",
        "Platforms share at least two thirds of their component classes",
        "Each platform is a file that names the classes of its components. The figures count classes, not rows: a "
        "class that serves three cameras counts once.",
        shared_components,
    ),
)
