"""The pixels of ``sensor_msgs/Image`` and ``CompressedImage``: encodings, rows, order of bytes, Bayer mosaics."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from spindoe._image import Color
from spindoe._native import read_image

# encoding: (type, channels in memory, color)
ENCODINGS: dict[str, tuple[str, int, Color]] = {
    "mono8": ("u1", 1, "gray"),
    "8UC1": ("u1", 1, "gray"),
    "mono16": ("u2", 1, "gray"),
    "16UC1": ("u2", 1, "gray"),
    "rgb8": ("u1", 3, "rgb"),
    "rgba8": ("u1", 4, "rgba"),
    "bgr8": ("u1", 3, "bgr"),
    "bgra8": ("u1", 4, "bgra"),
    "rgb16": ("u2", 3, "rgb"),
    "bgr16": ("u2", 3, "bgr"),
    # Their brightness comes first, as a whole image.
    "nv21": ("u1", 1, "gray"),
    "nv24": ("u1", 1, "gray"),
}
# encoding: which byte of a pixel's two is its brightness. Colors are left out.
LUMA: dict[str, int] = {"yuv422": 1, "uyvy": 1, "yuv422_yuy2": 0, "yuyv": 0}
# encoding: (type, colors of the first two rows' first two pixels)
MOSAICS: dict[str, tuple[str, str]] = {
    f"bayer_{colors}{bits}": (kind, colors)
    for colors in ("rggb", "bggr", "gbrg", "grbg")
    for bits, kind in ((8, "u1"), (16, "u2"))
}


def image_of(message: Any) -> tuple[NDArray[Any], Color]:
    """The pixels of a ``sensor_msgs/Image``, where they lie, or of a ``sensor_msgs/CompressedImage``, and the order of their
    channels. Bayer mosaics are made color images; of YUV images only the brightness is taken.

    Raises:
        ValueError: For an encoding or a format that has no pixels, too few bytes, or bytes that cannot be decoded.
    """
    if hasattr(message, "format"):
        return _decoded(message)
    if message.encoding in LUMA:
        return _rows(message, "u1", 2)[..., LUMA[message.encoding]], "gray"
    if message.encoding in MOSAICS:
        kind, colors = MOSAICS[message.encoding]
        return demosaic(_rows(message, kind, 1)[..., 0], colors), "rgb"
    if message.encoding not in ENCODINGS:
        known = ", ".join([*ENCODINGS, *LUMA, *MOSAICS])
        raise ValueError(f"encoding: expected one of {known}, found {message.encoding!r}")
    kind, channels, color = ENCODINGS[message.encoding]
    pixels = _rows(message, kind, channels)
    return (pixels[..., 0] if color == "gray" else pixels), color


def _rows(message: Any, kind: str, channels: int) -> NDArray[Any]:
    """The numbers of an ``Image``, without the padding of its rows; shape (height, width, channels)."""
    order = ">" if message.is_bigendian and kind == "u2" else "<"
    dtype = np.dtype(order + kind)
    data = np.frombuffer(message.data, dtype=np.uint8)
    size, used = message.height * message.step, message.width * channels * dtype.itemsize
    if len(data) < size or message.step < used:
        raise ValueError(
            f"data: expected {message.height} rows of {used} bytes or more, found {len(data)} bytes in rows of {message.step}"
        )
    rows = np.ascontiguousarray(data[:size].reshape(message.height, message.step)[:, :used])
    pixels = rows.view(dtype).reshape(message.height, message.width, channels)
    return pixels.astype(dtype.newbyteorder("="), copy=False)


def _decoded(message: Any) -> tuple[NDArray[Any], Color]:
    """The pixels of a ``CompressedImage``. Its format reads ``bgr8; jpeg compressed bgr8``, the encoding at the camera, the codec
    and the encoding of what is compressed; or names the codec alone."""
    if "compressedDepth" in message.format:
        raise ValueError(f"format: expected an image, found {message.format!r}")
    pixels = read_image("data", bytes(message.data))
    compressed = message.format.split()[-1:]
    if compressed and compressed[0] in MOSAICS:
        return demosaic(pixels[..., 0], MOSAICS[compressed[0]][1]), "rgb"
    return pixels, "rgb"


def demosaic(mosaic: NDArray[Any], colors: str) -> NDArray[Any]:
    """The color image of a Bayer mosaic, bilinear: what a pixel lacks is the mean of its nearest neighbors that have it.

    Args:
        mosaic: Shape (height, width), each at least 2; whole numbers of 8 or 16 bits.
        colors: Those of the first two rows' first two pixels, row by row: ``"rggb"``, ...

    Returns:
        Shape (height, width, 3), rgb, of the same type.
    """
    if min(mosaic.shape) < 2:
        raise ValueError(f"image: expected a mosaic of at least 2 x 2 pixels, found {mosaic.shape}")
    # Mirrored about the outer pixels, the mosaic goes on as it is. Sums of four fit.
    wide = np.pad(mosaic, 1, mode="reflect").astype(np.uint16 if mosaic.dtype == np.uint8 else np.uint32)
    image: NDArray[Any] = np.empty((*mosaic.shape, 3), dtype=mosaic.dtype)
    for place, own in enumerate(colors):
        row, column = divmod(place, 2)
        target = image[row::2, column::2]
        height, width = target.shape[:2]

        def at(down: int, right: int, row: int = row, column: int = column, size: Any = (height, width)) -> NDArray[Any]:
            """The neighbors of this place's pixels."""
            return wide[row + 1 + down :: 2, column + 1 + right :: 2][: size[0], : size[1]]

        beside, above = at(0, -1) + at(0, 1), at(-1, 0) + at(1, 0)
        target[..., "rgb".index(own)] = at(0, 0)
        if own == "g":
            # The other color of the row is beside, that of the other rows above and below.
            other = colors[place ^ 1]
            target[..., "rgb".index(other)] = (beside + 1) >> 1
            target[..., 2 - "rgb".index(other)] = (above + 1) >> 1
        else:
            target[..., 1] = (beside + above + 2) >> 2
            corners = at(-1, -1) + at(-1, 1) + at(1, -1) + at(1, 1)
            target[..., 2 - "rgb".index(own)] = (corners + 2) >> 2
    return image
