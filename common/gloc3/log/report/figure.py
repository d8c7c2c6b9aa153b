"""Drawings as files: matplotlib without a display, imported when it is needed, the same bytes for the same drawing."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gloc3.errors import Gloc3Error

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS: Final = (".svg", ".png", ".pdf")

_STYLE: Final[Any] = {
    "svg.hashsalt": "gloc3",
    "svg.fonttype": "path",
    "pdf.fonttype": 42,
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "axes.edgecolor": "#666666",
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "legend.frameon": False,
    "figure.dpi": 110,
}
_NO_DATE: Final = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}


@contextmanager
def drawing(file: Path, width_in: float, height_in: float, *, is_fitted: bool = True) -> "Iterator[Figure]":
    """A figure in the project's style; it is written to `file` at the end of the block.

    Args:
        file: the picture; its suffix is the format.
        width_in: its width in inches.
        height_in: its height in inches.
        is_fitted: whether the margins are computed by drawing everything twice; False: the caller sets them.

    Raises:
        Gloc3Error: matplotlib is not installed, the file's format is unknown, or it cannot be written.
    """
    if file.suffix not in FORMATS:
        raise Gloc3Error(f"cannot draw {file.name}: use one of {', '.join(FORMATS)}")
    if not file.absolute().parent.is_dir():
        raise Gloc3Error(f"cannot write {file}: there is no such folder")
    try:
        import matplotlib as mpl
        from matplotlib.figure import Figure
    except ModuleNotFoundError as error:
        raise Gloc3Error('drawing needs matplotlib; install it with: pip install "gloc3[logs]"') from error
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        figure = Figure(figsize=(width_in, height_in), layout="constrained" if is_fitted else None)
        yield figure
        try:
            figure.savefig(file, metadata=_NO_DATE.get(file.suffix))
        except OSError as error:
            raise Gloc3Error(f"cannot write {file}: {error.strerror}") from error


def thin(points: int, most: int = 5000) -> int:
    """Step with which `points` points are thinned out to at most `most`."""
    return max(1, -(-points // most))
