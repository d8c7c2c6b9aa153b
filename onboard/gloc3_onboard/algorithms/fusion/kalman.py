"""filterpy's `predict` and `update`, loaded without filterpy's statistics.

Those import all of `scipy.stats`, 40 MB and most of the time of loading, for one function that only filterpy's classes
of filters call.
"""

import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any, Final

from gloc3.loading import LOADING

_FILTERS: Final = "filterpy.kalman"
_STATISTICS: Final = "filterpy.stats"


def load_filter() -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Loads filterpy, and returns its functions `predict` and `update`."""
    with LOADING:
        if _FILTERS not in sys.modules and _STATISTICS not in sys.modules:
            stand_in = ModuleType(_STATISTICS)
            stand_in.__dict__["logpdf"] = _logpdf
            sys.modules[_STATISTICS] = stand_in
        try:
            from filterpy.kalman import predict, update
        finally:
            if getattr(sys.modules.get(_STATISTICS), "logpdf", None) is _logpdf:
                sys.modules.pop(_STATISTICS, None)
    return predict, update


def _logpdf(*values: Any, **options: Any) -> Any:
    """Filterpy's own, loaded by the first call."""
    from filterpy.stats import logpdf

    return logpdf(*values, **options)
