#!/usr/bin/env python3
"""Estimates a constant spin with SciPy alone, and compares it with `spindoe spin --json`.

    spindoe synth --as orientations -o o.csv --config outliers=0
    spindoe spin o.csv --json > spin.json
    python3 tests/python/check_spin.py o.csv spin.json

Orientations are read with scipy.spatial.transform.Rotation, whose quaternions are x, y, z, w; the file's
are w, x, y, z. The fit is least squares over the orientation and the spin, started from the spin to be
checked; it must stay there, and the standard deviations must agree with those of its Jacobian. It knows of
no outliers: give it a file of ten frames without.
"""

import csv
import json
import sys

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation


def main(orientations, spin):
    with open(orientations, newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["qw"]]
    times = np.array([float(row["time_s"]) for row in rows])
    scalar_last = [[float(row[k]) for k in ("qx", "qy", "qz", "qw")] for row in rows]
    measured = Rotation.from_quat(scalar_last)
    with open(spin, encoding="utf-8") as file:
        found = json.load(file)

    def residuals(x):
        # R(t) = exp([w]x (t - t0)) R(t0), the spin in the camera frame.
        turned = Rotation.from_rotvec(np.outer(times - times[0], x[3:]))
        predicted = turned * Rotation.from_rotvec(x[:3]) * measured[0]
        return (measured * predicted.inv()).as_rotvec().ravel()

    start = np.concatenate([np.zeros(3), found["spin_rad_s"]])
    fit = least_squares(residuals, start, xtol=1e-14, ftol=1e-14, gtol=1e-14, x_scale="jac")
    difference = np.abs(fit.x[3:] - found["spin_rad_s"])
    sigma = np.radians(found["sigma_deg"])
    std = sigma * np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))[3:]
    ratio = np.array(found["std_rad_s"]) / std
    print(f"SciPy    {fit.x[3:]} rad/s, std {std}")
    print(f"spindoe  {np.array(found['spin_rad_s'])} rad/s, std {np.array(found['std_rad_s'])}")
    # The command widens its standard deviations because the noise is estimated too: by 4 % for ten frames.
    assert np.all(difference < 1e-3 * std), difference / std
    assert np.all(np.abs(ratio - 1.04) < 0.02), ratio
    print("agree")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2])
