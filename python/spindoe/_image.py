"""Images at the border: what is taken as one, and what it is read as."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any, Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from . import _native

Color = Literal["gray", "rgb", "bgr", "rgba", "bgra"]


class PilImage(Protocol):
    """An image of Pillow, whose mode says what its channels are."""

    @property
    def mode(self) -> str: ...
    @property
    def __array_interface__(self) -> dict[str, Any]: ...


Image = NDArray[np.integer[Any] | np.floating[Any]] | PilImage | str | os.PathLike[str]
"""An array, as OpenCV's ``MatLike`` is one; an image of Pillow; the path of an image file."""

_PIL_MODES: dict[str, Color] = {"L": "gray", "I;16": "gray", "RGB": "rgb", "RGBA": "rgba"}


def pixels(name: str, image: Any, color: Color | None) -> tuple[Any, Color]:
    """An image as the native part takes it, and the order of its channels, ``gray``, ``rgb`` or ``bgr``.

    Arrays of whole numbers stay where they lie, but for those of another byte order. Floats from 0 to 1 are rounded to 16
    bits. Alpha is left out: the other channels are taken as they are.

    Raises:
        ValueError: Naming `name` or ``color``.
    """
    if image is None:
        raise ValueError(f"{name}: expected an image, found None: cv2.imread gives that for what it cannot read")
    if color is not None and color not in get_args(Color):
        raise ValueError(f"color: expected gray, rgb, bgr, rgba or bgra, found {color!r}")
    if isinstance(image, (str, os.PathLike)):
        _agrees(color, "rgb", "an image file")
        return _native.read_image(image, None), "rgb"
    # Open files and arrays in mapped memory have a mode, too.
    mode = None if isinstance(image, np.ndarray) else getattr(image, "mode", None)
    if isinstance(mode, str) and hasattr(type(image), "__array_interface__"):
        if mode not in _PIL_MODES:
            raise ValueError(
                f'{name}: expected a Pillow image of mode {", ".join(_PIL_MODES)}, found {mode}: image.convert("RGB")'
            )
        _agrees(color, _PIL_MODES[mode], f"a Pillow image of mode {mode}")
        image, color = np.asarray(image), _PIL_MODES[mode]
    if not isinstance(image, np.ndarray):
        # Refused by the native part, which names its type.
        return image, color or "gray"
    shape = image.shape
    if len(shape) == 3 and shape[2] == 1 and color in (None, "gray"):
        image, color = image[..., 0], "gray"
    if color is None:
        if len(shape) != 2:
            raise ValueError('color: expected "rgb" or "bgr" for images with channels (OpenCV reads bgr)')
        color = "gray"
    if color in ("rgba", "bgra"):
        if len(shape) != 3 or shape[2] != 4:
            raise ValueError(f"{name}: expected shape (height, width, 4) for {color}, found {shape}")
        image, color = image[..., :3], "rgb" if color == "rgba" else "bgr"
    elif color != "gray" and len(shape) == 3 and shape[2] == 4:
        raise ValueError(
            f'{name}: expected shape (height, width, 3) for {color}, found {shape}: color="{color}a" leaves alpha out'
        )
    return _whole(name, image), color


def rgb8(image: Any, color: Color | None) -> NDArray[np.uint8]:
    """An image to be shown, read as `pixels` reads it: red, green, blue, shape (height, width, 3), uint8; a copy.

    Raises:
        ValueError: Naming ``image`` or ``color``.
    """
    given, order = pixels("image", image, color)
    channels = () if order == "gray" else (3,)
    shape, dtype = np.shape(given), getattr(given, "dtype", type(given).__name__)
    if dtype not in (np.uint8, np.uint16) or len(shape) < 2 or shape[2:] != channels:
        raise ValueError(f"image: expected uint8 or uint16, {order}, found {dtype}, shape {shape}")
    levels: NDArray[np.uint8] = (given >> 8).astype(np.uint8) if dtype == np.uint16 else given
    if order == "gray":
        return np.repeat(levels[..., None], 3, axis=2)
    return np.array(levels[..., ::-1] if order == "bgr" else levels, order="C")


def frames_of(images: Any, color: Color | None) -> tuple[list[Any], Color]:
    """Images of the same channels, as `pixels` has them, named ``images[0]`` and so on."""
    if not isinstance(images, Iterable) or isinstance(images, (str, os.PathLike)):
        raise ValueError(f"images: expected a sequence of images, found {type(images).__name__}")
    frames: list[Any] = []
    order: Color = "gray"
    for i, image in enumerate(images):
        frame, own = pixels(f"images[{i}]", image, color)
        if frames and own != order:
            raise ValueError(f"images[{i}]: expected {order} as the first image, found {own}")
        order = own
        frames.append(frame)
    return frames, order


def _agrees(color: Color | None, own: Color, what: str) -> None:
    if color not in (None, own):
        raise ValueError(f'color: expected "{own}" or none for {what}, found "{color}"')


def _whole(name: str, image: NDArray[Any]) -> NDArray[Any]:
    """Floats from 0 to 1 as 16 bits, which hold those of image files exactly; other arrays as they are, in the machine's order
    of bytes."""
    if not image.dtype.isnative:
        image = image.astype(image.dtype.newbyteorder("="))
    if image.dtype.kind != "f" or not image.size:
        return image
    low, high = image.min(), image.max()
    if not (low >= 0.0 and high <= 1.0):
        raise ValueError(f"{name}: expected floats from 0 to 1, found {low:g} to {high:g}")
    deep: NDArray[Any] = np.rint(np.multiply(image, 65535.0, dtype=np.float64)).astype(np.uint16)
    return deep
