"""Fuzzes one target with atheris, in a process of its own: `python -m tests.fuzz.engine MODULE NAME CODE… -- OPTIONS`."""

import importlib
import sys
import warnings

import atheris
from tests.fuzz.target import TARGETS, judge, keep, smaller


def main(words: list[str]) -> None:
    """Imports the target's code with instructions that count its branches, and searches until the time is over."""
    given, options = words[: words.index("--")], words[words.index("--") + 1 :]
    module, name, *code = given
    warnings.simplefilter("error")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with atheris.instrument_imports(include=code):
            importlib.import_module(module)
    target, seen = TARGETS[name], set[tuple[str, str]]()

    def run(data: bytes) -> None:
        broken = judge(target, data)
        if broken is None or broken[:2] in seen:
            return
        seen.add(broken[:2])
        path = keep(target, smaller(target, data, broken), broken)
        print(f"FOUND {path.name} {broken.what} at {broken.where}: {broken.text}", file=sys.stderr, flush=True)

    atheris.enabled_hooks.add("str")  # not "RegEx": its patterns lack arguments that the standard library passes
    atheris.Setup([sys.argv[0], *options], run)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1:])
