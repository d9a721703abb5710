#!/usr/bin/env python3
"""Reads a hash table with NumPy alone, checks it, and identifies a view with it.

    python3 examples/read_table.py table.npz

It shows what an estimator in Python needs: the arrays, how a feature is made, and a nearest-neighbor
search. The identification itself is best left to `spindoe identify`, which knows missed and false dots.
"""

import json
import sys

import numpy as np


def feature(d, d2, d3):
    """h = B^-1 d3 with B = [d, d2, d x d2]; unit vectors of shape (3,)."""
    return np.linalg.solve(np.stack([d, d2, np.cross(d, d2)], axis=1), d3)


def main(path):
    table = np.load(path)
    dots, features = table["dots"], table["features"]
    bases, third = table["bases"], table["feature_dots"]
    meta = json.loads(table["meta"].tobytes())
    print(f"{len(dots)} dots, {len(features)} features, format {meta['format_version']}")
    print(f"pairs left out by {meta['pair_rule']}")

    # Every feature follows from the dots.
    for h, (i, j), k in zip(features, bases, third):
        assert np.allclose(feature(dots[i], dots[j], dots[k]), h, rtol=0, atol=1e-9)

    # A view: the ball turned at random, three of its dots, no noise. The nearest feature identifies them.
    rng = np.random.default_rng(0)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    row = rng.integers(len(features))
    seen = dots[[*bases[row], third[row]]] @ turn.T
    found = np.argmin(np.linalg.norm(features - feature(*seen), axis=1))
    assert found == row
    print(f"identified: dots {bases[found].tolist()} and {third[found]}, as drawn")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
