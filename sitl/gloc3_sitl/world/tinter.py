"""Colours of a camera's pictures: the textures' tints, drawn at half the resolution over the grey picture.

Light, haze, blur and noise are those of the grey picture, which does not change: processors of grey values work alike
with and without colours. As in JPEG, colours are coarser than brightness.
"""

from typing import Final

from msgspec.structs import replace

from gloc3.camera.geometry import matrix
from gloc3.camera.model import CameraModel
from gloc3.camera.opencv import load_opencv
from gloc3_sitl.world.patches import PatchView
from gloc3_sitl.world.placing import WorldPlacement
from gloc3_sitl.world.sheets import Sheets
from gloc3_sitl.world.studio import Renderer, optics_of
from gloc3_sitl.world.texture import NEUTRAL, Image
from gloc3_sitl.world.world import World

_COARSER: Final = 2


class Tinter:
    """Colours the pictures of one camera.

    Args:
        world: scene.
        model: the camera.
    """

    def __init__(self, world: World, model: CameraModel) -> None:
        self._cv2 = load_opencv()
        self._size = (model.width, model.height)
        self._optics = optics_of(_coarse(model))
        sheets = Sheets(world, is_tint=True)
        self._renderers = [Renderer(sheets, canvas.pinhole) for canvas in self._optics.canvases]

    def coloured(self, grey: Image, eye: WorldPlacement, t_s: float) -> Image:
        """A grey picture in colour, shape `(rows, columns, 3)`: blue, green and red.

        Args:
            grey: the finished picture.
            eye: placement of the camera (axes right, down, forward) in the middle of the exposure.
            t_s: that time.
        """
        cv2, rotation = self._cv2, matrix(eye.local_from_here).T
        tint = self._optics.bend(
            [
                renderer.draw(PatchView(canvas.face_from_rdf @ rotation, eye.position_m, t_s))
                for canvas, renderer in zip(self._optics.canvases, self._renderers, strict=True)
            ]
        )
        tint[cv2.inRange(tint, (0, 0, 0), (0, 0, 0)) > 0] = NEUTRAL  # where the lens shows nothing
        whole = cv2.resize(tint, self._size, interpolation=cv2.INTER_LINEAR)
        found: Image = cv2.multiply(cv2.merge([grey, grey, grey]), whole, scale=1.0 / NEUTRAL)
        return found


def _coarse(model: CameraModel) -> CameraModel:
    """The same view with fewer pixels."""
    width, height = max(16, model.width // _COARSER), max(16, model.height // _COARSER)
    across, down = width / model.width, height / model.height
    (focal_x, focal_y), (center_x, center_y) = model.focal_px, model.center_px
    return replace(
        model,
        width=width,
        height=height,
        focal_px=(focal_x * across, focal_y * down),
        center_px=((center_x + 0.5) * across - 0.5, (center_y + 0.5) * down - 0.5),
    )
