#!/usr/bin/env python3
"""Checks the pieces of a stencil's halves with trimesh and Manifold.

    check_pieces.py DIR...

DIR is a folder that `spindoe stencil --segments N` wrote. It shares no code with the crate. Needs trimesh, rtree and
manifold3d. Ends with 1 where a check fails.
"""

import itertools
import json
import sys
from pathlib import Path

import numpy as np
import trimesh

# Points of the wall that are tried, and points around a hole; distance from its edge, mm.
PLACES, AROUND, BESIDE_MM = 3000, 24, 0.5


def common(a, b):
    mesh = trimesh.boolean.intersection([a, b], engine="manifold")
    return mesh.volume if len(mesh.faces) else 0.0


def check_half(directory, description, name):
    half = description[f"half_{name}"]
    whole = trimesh.load(directory / half["file"])
    lip = np.array([0.0, 0.0, description["joint"]["lip_mm"]])
    sizes = description["parameters"]
    faults, pieces = [], []
    for piece in half["pieces"]:
        mesh = trimesh.load(directory / piece["file"])
        holes = (2 - mesh.euler_number) / 2
        if not (mesh.is_watertight and mesh.is_winding_consistent and mesh.body_count == 1):
            faults.append(f"{piece['file']}: no closed body")
        if holes != piece["through_holes"]:
            faults.append(f"{piece['file']}: {holes} holes, expected {piece['through_holes']}")
        if abs(mesh.bounds[0, 2]) > 1e-4:
            faults.append(f"{piece['file']}: not on the bed")
        back = trimesh.transformations.rotation_matrix(-np.radians(piece["turn_deg"]), [0, 0, 1])
        pieces.append(mesh.apply_transform(back))
    overlap = max(common(a, b) for a, b in itertools.combinations(pieces, 2))
    if overlap > 1e-3:
        faults.append(f"{overlap:.4f} mm^3 are in two pieces")
    outside = max(mesh.volume - common(mesh, whole) for mesh in pieces)
    if outside > 1.0:
        faults.append(f"{outside:.3f} mm^3 of a piece are outside the half")
    # Directions all over the dome, in the middle of the wall.
    radius = 0.5 * sizes["ball_diameter_mm"] + sizes["clearance_mm"] + 0.5 * sizes["wall_mm"]
    places = np.random.default_rng(0).normal(size=(PLACES, 3))
    places /= np.linalg.norm(places, axis=1)[:, None]
    places[:, 2] = abs(places[:, 2])
    places = radius * places + lip
    wall = whole.contains(places)
    held = np.sum([mesh.contains(places) for mesh in pieces], axis=0)
    # Of each hole in this half alone the edge is one piece's, and the inside free.
    for dot in description["dots"]:
        if dot["half"] != name or dot["through_both_rims"]:
            continue
        latitude, azimuth = np.radians([dot["latitude_deg"], dot["azimuth_deg"]])
        axis = np.array(
            [np.cos(latitude) * np.cos(azimuth), np.cos(latitude) * np.sin(azimuth), np.sin(latitude)]
        )
        if name == "b":
            axis *= [1, -1, -1]
        u = np.cross(axis, [0.3, 0.5, 0.8])
        u /= np.linalg.norm(u)
        turns = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
        ways = np.outer(np.cos(turns), u) + np.outer(np.sin(turns), np.cross(axis, u))
        throat = radius - 0.3 * sizes["wall_mm"]

        def ring(r):
            return np.sqrt(throat**2 - r**2) * axis + r * ways + lip

        edge = 0.5 * sizes["hole_diameter_mm"]
        outer = [mesh.contains(ring(edge + BESIDE_MM)) for mesh in pieces]
        inner = [mesh.contains(ring(edge - BESIDE_MM)).any() for mesh in pieces]
        if sum(o.any() for o in outer) != 1 or not any(o.all() for o in outer):
            faults.append(f"the hole of dot {dot['dot']} is cut")
        if any(inner):
            faults.append(f"the hole of dot {dot['dot']} is blocked")
    parts = sum(mesh.volume for mesh in pieces)
    print(
        f"{directory}, half {name}: {len(pieces)} pieces, {100 * parts / whole.volume:.2f} % of the half's volume, "
        f"{int(((held == 0) & wall).sum())} of {int(wall.sum())} places of its wall in no piece, common volume "
        f"{overlap:.4f} mm^3"
    )
    return faults


def check_opening(directory, description):
    """The common volume of the halves with their ribs, from closed to half a turn open."""
    lip, axis = description["joint"]["lip_mm"], description["joint"]["axis_mm"]
    a, b = (trimesh.load(directory / f"half_{name}.stl").apply_translation([0, 0, -lip]) for name in "ab")
    b.apply_transform(np.diag([1.0, -1.0, -1.0, 1.0]))
    found = 0.0
    for degrees in (0, 5, 20, 60, 120, 170, 180):
        turn = trimesh.transformations.rotation_matrix(-np.radians(degrees), [0, 1, 0], [axis, 0, 0])
        found = max(found, common(a, b.copy().apply_transform(turn)))
    return [f"opening, the halves share {found:.4f} mm^3"] if found > 1e-3 else []


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    faults = []
    for directory in map(Path, sys.argv[1:]):
        description = json.loads((directory / "stencil.json").read_text())
        for name in "ab":
            faults += check_half(directory, description, name)
        faults += check_opening(directory, description)
    for fault in faults:
        print("FAULT:", fault)
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
