#!/usr/bin/env python3
"""The dot detector in Python: finds the dots of one ball with ONNX Runtime, NumPy and Pillow alone.

    python -c "import spindoe; spindoe.write_onnx('dots.onnx')"
    python3 examples/detect_dots.py dots.onnx ball.png U V R

U V R is the ball's circle in pixels (center of the top-left pixel at 0, 0). Prints a dot a line: its pixel, standard
deviations along u and v, and the probability that it is a dot. The steps are those of src/vision/dots/patch.rs and
src/vision/dots/net.rs.
"""

import sys

import numpy as np
import onnxruntime
from PIL import Image

SIZE, RADIUS, RIM = 64, 28.0, 1.1
MIDDLE = (SIZE - 1) / 2


def bilinear(image, u, v):
    height, width = image.shape
    u, v = np.clip(u, 0, width - 1), np.clip(v, 0, height - 1)
    u0, v0 = u.astype(int), v.astype(int)
    u1, v1 = np.minimum(u0 + 1, width - 1), np.minimum(v0 + 1, height - 1)
    fu, fv = u - u0, v - v0
    top = image[v0, u0] * (1 - fu) + image[v0, u1] * fu
    low = image[v1, u0] * (1 - fu) + image[v1, u1] * fu
    return top * (1 - fv) + low * fv


def cut(image, u, v, r):
    """The patch of a gray image (values 0 to 1) for the circle at (u, v) with radius r."""
    step = r / RADIUS
    fine = int(np.clip(np.ceil(step), 1, 64))
    sub = (np.arange(fine) + 0.5) / fine - 0.5
    at = (np.arange(SIZE)[:, None] - MIDDLE + sub[None]).ravel()
    uu, vv = np.meshgrid(u + step * at, v + step * at)
    patch = bilinear(image, uu, vv).reshape(SIZE, fine, SIZE, fine).mean(axis=(1, 3))
    column, row = np.meshgrid(np.arange(SIZE) - MIDDLE, np.arange(SIZE) - MIDDLE)
    out = np.hypot(column, row)
    ball = patch[out < 0.97 * RADIUS]
    patch = (patch - ball.mean()) / max(ball.std(), 0.01)
    return np.where(out > RIM * RADIUS, 0, patch).astype(np.float32)


def detect(session, image, u, v, r, min_probability=0.3):
    """Rows of (u, v, deviation of u, deviation of v, probability), the most probable first."""
    patch = cut(image, u, v, r)[None, None]
    cells, probability = session.run(["cells", "probability"], {"patches": patch})
    heat, (_, du, dv, ln_a, b, ln_c) = cells[0, 0], cells[0]
    factor = float(session.get_modelmeta().custom_metadata_map["covariance_factor"])
    padded = np.pad(heat, 1, constant_values=-np.inf)
    shifts = [padded[i : i + 32, j : j + 32] for i in range(3) for j in range(3)]
    peaks = np.argwhere((heat >= np.max(shifts, axis=0)) & (probability[0, 0] >= min_probability))
    found = []
    for i, j in sorted(peaks.tolist(), key=lambda ij: -heat[tuple(ij)]):
        column, row = 2 * j + 0.5 + du[i, j], 2 * i + 0.5 + dv[i, j]
        if any(np.hypot(column - f[0], row - f[1]) < 2 for f in found):
            continue
        a, c = np.exp(np.clip([ln_a[i, j], ln_c[i, j]], -2.5, 4))
        inverse = np.array([[1 / a, 0], [-b[i, j] / (a * c), 1 / c]])
        deviation = np.sqrt(np.diag(factor * inverse @ inverse.T))
        found.append([column, row, *deviation, probability[0, 0, i, j]])
    step = r / RADIUS
    return [
        (u + step * (x - MIDDLE), v + step * (y - MIDDLE), step * su, step * sv, p)
        for x, y, su, sv, p in found
    ]


def read_gray(path):
    """The image's gray, values 0 to 1, of 8 or 16 bits."""
    image = Image.open(path)
    if image.mode.startswith("I"):
        # Pillow reads gray of 16 bits as such; converted to RGB it would be cut off at 255.
        return np.asarray(image, dtype=np.float64) / 65535
    rgb = np.asarray(image.convert("RGB"), dtype=np.float64) / 255
    return rgb @ [0.2126, 0.7152, 0.0722]


def main(model, path, *circle):
    gray = read_gray(path)
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    for dot in detect(session, gray, *map(float, circle)):
        print("u %.2f v %.2f  +- %.2f %.2f  p %.3f" % dot)


if __name__ == "__main__":
    main(*sys.argv[1:])
