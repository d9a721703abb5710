#!/usr/bin/env python3
"""Runs the exported net with ONNX Runtime, and compares its cells with those of spindoe's own inference.

    python3 tests/python/check_onnx.py dots.onnx patches.f32 cells.f32

Both files are raw 32-bit little-endian floats: n x 1 x 64 x 64 and n x 6 x 32 x 32. Prints the largest difference;
fails where it exceeds what the order of summation can explain. Where the
package `onnx` is installed, its strict checker must accept the file too.
"""

import sys

import numpy as np
import onnxruntime

try:
    import onnx
except ImportError:
    onnx = None


def main(model, patches, cells):
    if onnx:
        onnx.checker.check_model(model, full_check=True)
        print("valid by onnx.checker")
    patches = np.fromfile(patches, "<f4").reshape(-1, 1, 64, 64)
    expected = np.fromfile(cells, "<f4").reshape(-1, 6, 32, 32)
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    found, probability = session.run(["cells", "probability"], {"patches": patches})
    meta = session.get_modelmeta().custom_metadata_map
    odds = float(meta["slope"]) * expected[:, :1] + float(meta["offset"])
    difference = np.abs(found - expected).max()
    difference_p = np.abs(probability - 1 / (1 + np.exp(-odds))).max()
    print(f"{len(patches)} patches: cells differ by at most {difference:.2e}, probabilities by {difference_p:.2e}")
    scale = np.abs(expected).max()
    if not (difference < 1e-4 * max(scale, 1.0) and difference_p < 1e-3):
        sys.exit("they disagree")
    print("they agree")


if __name__ == "__main__":
    main(*sys.argv[1:])
