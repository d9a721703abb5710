"""From light to the bytes of a picture: defocus, mosaic, noise, tone, JPEG."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

LUMA = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True)
class Sensor:
    """What a camera makes of the light."""

    defocus_px: float
    level: float
    """Signal of the bright parts of ball and picture; 1 is full."""
    read_noise: float
    shot_noise: float
    has_color: bool
    has_mosaic: bool
    encoding: str
    gamma: float
    jpeg_quality: int | None
    half_color: bool


def draw(rng: np.random.Generator, kind: str) -> Sensor:
    """A camera's sensor; of a dim scene one that is underexposed, to a sixth to two fifths of the picture's range."""
    is_dim = kind == "dim"
    has_color = rng.random() < 0.65
    tone = rng.random()
    encoding, gamma = "linear", 1.0
    if tone < 0.5:
        encoding = "srgb"
    elif tone < 0.75:
        gamma = 1.0 / rng.uniform(1.8, 2.4)
    level = rng.uniform(0.45, 0.95)
    if is_dim:
        shown = rng.uniform(0.15, 0.4)
        level = ((shown + 0.055) / 1.055) ** 2.4 if encoding == "srgb" else shown ** (1 / gamma)
    return Sensor(
        defocus_px=float(rng.uniform(0.1, 1.2)),
        level=float(level),
        read_noise=float(rng.uniform(0.002, 0.006) if is_dim else rng.uniform(0.001, 0.004)),
        shot_noise=float(1.0 / np.exp(rng.uniform(*np.log((3000, 20000))))),
        has_color=has_color,
        has_mosaic=has_color and rng.random() < 0.5,
        encoding=encoding,
        gamma=float(gamma),
        jpeg_quality=int(rng.integers(75, 96)) if rng.random() < 0.3 else None,
        half_color=bool(rng.random() < 0.5),
    )


CLEAN = Sensor(0.0, 0.8, 0.0, 0.0, False, False, "linear", 1.0, None, False)


def defocused(light: NDArray, sensor: Sensor) -> NDArray:
    """Blurred by the lens."""
    if sensor.defocus_px <= 0.0:
        return light
    return ndimage.gaussian_filter(light, (sensor.defocus_px, sensor.defocus_px, 0.0), mode="nearest")


def demosaiced(signal: NDArray) -> NDArray:
    """Each pixel's one color (red at the even rows and columns, blue at the odd ones), the others interpolated."""
    rows, columns = np.indices(signal.shape)
    color = rows % 2 + columns % 2
    near = np.array([[1.0, 2.0, 1.0], [2.0, 4.0, 2.0], [1.0, 2.0, 1.0]])
    planes = []
    for plane in range(3):
        mask = color == plane
        weight = mask.astype(float)
        total = ndimage.convolve(signal * weight, near, mode="mirror")
        planes.append(np.where(mask, signal, total / ndimage.convolve(weight, near, mode="mirror")))
    return np.stack(planes, axis=-1)


def encoded(signal: NDArray, sensor: Sensor) -> NDArray:
    """The tone curve."""
    value = np.clip(signal, 0.0, 1.0)
    if sensor.encoding == "srgb":
        high = 1.055 * np.maximum(value, 1e-9) ** (1 / 2.4) - 0.055
        value = np.where(value <= 0.0031308, 12.92 * value, high)
    return value**sensor.gamma


def brightness(light: NDArray, ball: NDArray) -> float:
    """What a camera is exposed for. `ball` says which pixels show the ball, if any do."""
    luma = light @ LUMA
    around = np.percentile(luma, 80)
    return float(max(np.percentile(luma[ball], 97), around) if ball.any() else around)


def picture(
    light: NDArray, bright: float, sensor: Sensor, rng: np.random.Generator
) -> tuple[NDArray, bytes | None]:
    """Eight bits, gray or color, and the JPEG's bytes where it is one, of light that went through the lens."""
    signal = light * (sensor.level / max(bright, 1e-9))
    if not sensor.has_color:
        signal = (signal @ LUMA)[..., None]
    elif sensor.has_mosaic:
        rows, columns = np.indices(signal.shape[:2])
        color = (rows % 2) + (columns % 2)
        signal = np.take_along_axis(signal, color[..., None], axis=-1)
    spread = np.sqrt(sensor.read_noise**2 + sensor.shot_noise * np.maximum(signal, 0.0))
    signal = signal + spread * rng.standard_normal(signal.shape)
    if sensor.has_mosaic:
        signal = demosaiced(np.clip(signal[..., 0], 0.0, 1.0))
    values = np.rint(255.0 * encoded(signal, sensor)).astype(np.uint8)
    values = values[..., 0] if values.shape[-1] == 1 else values
    if sensor.jpeg_quality is None:
        return values, None
    file = io.BytesIO()
    subsampling = 2 if sensor.half_color else 0
    Image.fromarray(values).save(file, "JPEG", quality=sensor.jpeg_quality, subsampling=subsampling)
    return np.asarray(Image.open(file)), file.getvalue()
