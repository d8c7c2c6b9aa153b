"""Loading of libraries that only some components need, from several threads."""

import importlib
from threading import RLock
from typing import Final

LOADING: Final = RLock()
"""Held while modules are loaded."""


def load_modules(*names: str) -> None:
    """Imports modules, one thread at a time; an `import` of them after it is safe in any thread.

    Components are initialized side by side. Where two threads import parts of one package in different orders, Python
    breaks the deadlock by handing one of them a module that is only half loaded ("partially initialized module").
    """
    with LOADING:
        for name in names:
            importlib.import_module(name)
