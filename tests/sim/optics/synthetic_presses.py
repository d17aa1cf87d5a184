"""Ball presses rendered from a known optical model, for the tests of the calibration."""

import numpy as np

from sim.optics.calibrate.ball_press import BallPress, Circle
from sim.optics.calibrate.circle_and_light import PressScene
from sim.optics.colour.photometric import PhotometricModel, polynomial_exponents
from tests.sim.optics.analytic_surface import ExponentialSkirt, camera

HEIGHT, WIDTH = 150, 180
PROFILE = ExponentialSkirt(ball_radius_m=2.35e-3, decay_m=0.6e-3)
EXPONENTS = polynomial_exponents(
    tilt_degree=3, position_degree=1, indentation_degree=1, indentation_tilt_degree=1
)


def true_model() -> PhotometricModel:
    """Give lamps of three colours with some curvature, fall-off and darkening with depth."""
    rng = np.random.default_rng(5)
    coefficients = rng.normal(0.0, 4.0, (len(EXPONENTS), 3))
    rows = {tuple(term): i for i, term in enumerate(EXPONENTS.tolist())}
    coefficients[rows[1, 0, 0, 0, 0]] += (-30.0, -30.0, 60.0)
    coefficients[rows[0, 1, 0, 0, 0]] += (-50.0, 50.0, 0.0)
    coefficients[rows[0, 0, 0, 0, 1]] += (-12.0, -10.0, -8.0)
    return PhotometricModel(exponents=EXPONENTS, coefficients=coefficients)


def press_scene() -> PressScene:
    """Give a camera of 0.1 mm pixels and an uneven no-contact frame."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    background = np.stack([110 + 0.1 * columns, 120 + 0.1 * rows, 140 - 0.1 * columns], axis=-1)
    return PressScene(
        geometry=camera(WIDTH, HEIGHT),
        background=np.rint(background),
        profile=PROFILE,
        exponents=EXPONENTS,
    )


def presses(
    count: int,
    *,
    noise: float = 1.0,
    click_px: float = 0.0,
    light: float = 0.0,
    seed: int = 0,
    model: PhotometricModel | None = None,
) -> tuple[list[BallPress], list[Circle], np.ndarray]:
    """Render presses at random places.

    Args:
        count: How many.
        noise: Standard deviation of the pixels' noise [grey levels].
        click_px: Standard deviation of the labels' error in x, y and radius [px].
        light: Standard deviation of each frame's colour offset [grey levels].
        seed: Of the random numbers.
        model: Colours them; ``true_model`` if None.

    Returns:
        The presses as labelled, the true circles, and the true light offsets [count, 3].
    """
    rng = np.random.default_rng(seed)
    scene, colours = press_scene(), model or true_model()
    pixels = scene.whole_image(colours)
    labelled, circles = [], []
    offsets = rng.normal(0.0, 1.0, (count, 3)) * light
    for i in range(count):
        circle = Circle(
            x_px=rng.uniform(60, 120), y_px=rng.uniform(60, 90), radius_px=rng.uniform(14, 20)
        )
        change = pixels.predict(circle).reshape(HEIGHT, WIDTH, 3)
        image = scene.background + change + offsets[i] + rng.normal(0, noise, change.shape)
        error = rng.normal(0.0, 1.0, 3) * click_px
        label = Circle(
            x_px=circle.x_px + error[0],
            y_px=circle.y_px + error[1],
            radius_px=circle.radius_px + error[2],
        )
        shown = np.clip(np.rint(image), 0, 255).astype(np.uint8)
        labelled.append(BallPress(name=f"{i:04d}.png", image=shown, circle=label))
        circles.append(circle)
    return labelled, circles, offsets
