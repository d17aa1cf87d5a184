"""Images and markers of many pressed gels, from the nodes that a solver holds on its device."""

from typing import Any

import numpy as np
import warp as wp

from sim.device import Device
from sim.fields.saved_press import top_surface
from sim.optics.colour.model_interface_and_response import ColourModel
from sim.optics.colour.nominal_optics import nominal_model
from sim.optics.height.height_map import TOUCHING_M, SurfaceHeights, gap_left
from sim.optics.markers.marker_tracking import find_markers
from sim.optics.markers.simulated_markers import MarkerPrinter, SeenPoints, marker_places
from sim.optics.render.renderer import GREY_LEVEL, TactileRenderer
from sim.scene.indenter import Indenter, IndenterSet
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.sensor import Sensor
from sim.solve.model import Model
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import ConfigError


class SurfaceImages:
    """Renders camera images of environments that share a model and an indenter.

    Results stay on the model's device, in arrays that the next call overwrites; PyTorch and JAX
    take them through DLPack. Nothing waits for the device: after a first call, which compiles
    kernels, a CUDA graph can hold the others. A half or a quarter of a pad is drawn whole. An
    environment whose nodes are not numbers has a black image.

    Args:
        model: Model of the pad, whose nodes are rendered.
        sensor: Sensor with camera, pad, markers and defaults of the arguments below.
        samples: Samples per pixel in each direction; replays take 2.
        background: No-contact frame, RGB, uint8, shape [height, width, 3]; the markers that it
            shows go with the gel. Evenly grey by default.
        blur_px: Standard deviation of the camera's blur [px].

    Attributes:
        dents: Unloaded minus loaded height of the last images [m], Warp float32, shape [count,
            samples * height, samples * width].

    Raises:
        ConfigError: The sensor has no nominal optics, a marker lies beside the gel, or the gel
            covers no pixel.
    """

    def __init__(
        self,
        model: Model,
        indenter: Indenter | IndenterSet,
        sensor: Sensor,
        *,
        count: int,
        samples: int = 1,
        background: ImageArray | None = None,
        colours: ColourModel | None = None,
        geometry: CameraGeometry | None = None,
        blur_px: float = 0.0,
    ) -> None:
        self._device = device = Device(model.device)
        self._shape = (count, len(model.nodes))
        geometry, top = geometry or sensor.camera, top_surface(model)
        fine, options = geometry.refined(samples), model.contact_options
        self._upright: Any = device.array(np.tile(np.eye(3), (count, 1, 1)), wp.mat33d)
        on: dict[str, Any] = {"count": count, "device": model.device}
        self._heights = SurfaceHeights(
            top,
            indenter,
            fine,
            standoff_m=options.distance_m,
            contact_gap_m=gap_left(TOUCHING_M, 0.0 if options.is_wide else options.distance_m),
            pad=sensor.pad,
            **on,
        )
        markers = None if background is None else find_markers(background)
        if background is None:
            shape = (geometry.height, geometry.width, 3)
            background = np.full(shape, GREY_LEVEL, dtype=np.uint8)
        renderer = TactileRenderer(
            background if markers is None else markers.bare,
            self._heights.rest_m.numpy().reshape(fine.height, fine.width),
            colours or nominal_model(sensor),
            geometry,
            shadows=sensor.optics.shadows,
            samples=samples,
            blur_px=blur_px,
            device=model.device,
        )
        self.dents, self._render = renderer.prepared(count)
        places = marker_places(sensor.markers) if sensor.markers else np.zeros((0, 2))
        self._points = SeenPoints(top, places, geometry, **on)
        self._printer = None if markers is None else MarkerPrinter(top, markers, geometry, **on)

    def images(self, positions: Any, tips: Any, rotations: Any = None) -> Any:
        """Return images, RGB, Warp uint8, shape [count, height, width, 3].

        Args:
            positions: Nodes of the model [m], Warp vec3d, shape [count, node_count].
            tips: The indenter's in the pad's frame [m], Warp vec3d, shape [count].
            rotations: Indenter frame to pad frame, Warp mat33d, shape [count]; upright by default.

        Raises:
            ConfigError: An array has not the shape that it is to have.
        """
        turned = self._upright if rotations is None else rotations
        self._refuse_unfit(positions, tips, turned)
        self._heights.dents(positions, tips, turned, self.dents)
        images = self._render()
        if self._printer is not None:
            self._printer.over(images, positions)
        return images

    def markers(self, positions: Any) -> Any:
        """Return column and row of the markers [px], Warp float32, shape [count, marker_count, 2].

        They are in the order of ``marker_places``; none where the sensor's file has none.
        """
        self._refuse_unfit(positions)
        return self._points.pixels(positions)

    def _refuse_unfit(self, positions: Any, *poses: Any) -> None:
        found = [tuple(array.shape) for array in (positions, *poses)]
        expected = [self._shape, *[self._shape[:1]] * len(poses)]
        if found != expected:
            raise ConfigError(
                f"nodes, tips and rotations have the shapes {found}, the environments {expected}",
                remedy="give all environments at once, with the nodes of the model",
            )
