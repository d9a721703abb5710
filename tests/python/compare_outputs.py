"""Compares what two builds of the command write: the same arguments and seeds, file by file.

    python compare_outputs.py OLD_BINARY NEW_BINARY [--objectives mean-nn,whitened-nn] [--keep DIR]

Compared byte for byte: pattern.csv (but for a header line), the arrays of table.npz, sensitivity.csv,
stencils (STL), the CSV files of identify and spin, the dots that validate dumps. JSON files are compared
value by value, but for times, versions and the command; keys that were renamed count as the same, and
keys that the new binary adds are listed. `estimate` may differ by 1e-4. Exit code 1 where anything
differs. Needs nothing but Python's standard library.
"""

import argparse
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import zipfile

# Old key -> new key, and old parts of keys and words -> new ones.
RENAMED = {"figure": "value", "figure_before": "value_before", "most_grey": "max_background"}
RESPELLED = {
    "recogniser": "recognizer", "least_": "min_", "most_": "max_", "centre": "center",
    "colour": "color", "grey": "gray", "millimetre": "millimeter",
}
# Clock times, and what a new version writes by intent.
IGNORED = {
    "command", "elapsed_s", "format_version", "median_us_per_identification", "seconds",
    "spindoe_version", "timing", "us_per_identification", "version",
}
RECOGNIZERS = ("voting", "robust")
PROTOCOLS = ("paper", "sparse", "clutter", "image")
TOLERANCE = 1e-4


def run(binary, folder, *arguments):
    """Runs the command in `folder` and returns its standard output."""
    found = subprocess.run([binary, *arguments], cwd=folder, capture_output=True, text=True)
    if found.returncode != 0:
        raise SystemExit(f"{binary} {' '.join(arguments)}: {found.stderr.strip()}")
    return found.stdout


def produce(binary, folder, objectives, pattern):
    """Writes everything that is compared into `folder`."""
    for name in objectives:
        run(binary, folder, "design", "--dots", "10", "--config=starts=3", "--config=rounds=2", "--samples",
            "100", "--seed", "1", f"--config=objective={name}", "-o", f"design-{name}")
    (folder / "given.csv").write_text(pattern)
    run(binary, folder, "table", "given.csv", "-o", "table.npz")
    run(binary, folder, "validate", "given.csv", "--sweep=noise", "--config=sweep_alpha=0.003,0.01,0.03,0.1,0.3,1",
        "-o", "sweep", "--samples", "50", "--seed", "2")
    run(binary, folder, "stencil", "given.csv", "-o", "stencil")
    for protocol in PROTOCOLS:
        run(binary, folder, "synth", "given.csv", "--as=dots", "--protocol", protocol, "--frames", "300",
            "--seed", "3", "-o", f"{protocol}.csv")
        for name in RECOGNIZERS:
            words = run(binary, folder, "validate", "given.csv", "--protocol", protocol,
                        f"--config=recognizer={name}", "--samples", "300", "--seed", "3", "--json")
            (folder / f"validate-{protocol}-{name}.json").write_text(words)
            run(binary, folder, "identify", "--table", "table.npz", f"{protocol}.csv",
                f"--config=recognizer={name}", "-o", f"identify-{protocol}-{name}.csv")
    run(binary, folder, "synth", "--as=orientations", "-o", "turning.csv", "--rps", "30", "--frames", "12", "--seed", "4")
    for method in ("quatera", "robust"):
        words = run(binary, folder, "spin", "turning.csv", f"--config=method={method}", "--json")
        (folder / f"spin-{method}.json").write_text(words)
    run(binary, folder, "synth", "given.csv", "--as=images", "-o", "images", "--frames", "6", "--seed", "5",
        "--config=size_px=100")
    run(binary, folder, "estimate", "--table", "table.npz", "images/images", "-o", "estimate.csv")


def respelled(word):
    for old, new in RESPELLED.items():
        word = word.replace(old, new)
    return word


def renamed(value):
    """A JSON value with old keys and words renamed, and what is not compared left out."""
    if isinstance(value, dict):
        kept = ((k, v) for k, v in value.items() if k not in IGNORED)
        return {respelled(RENAMED.get(k, k)): renamed(v) for k, v in kept}
    if isinstance(value, str):
        return respelled(value)
    return [renamed(v) for v in value] if isinstance(value, list) else value


def json_differences(old, new, place=""):
    """Places where two values differ, and keys that only the new one has."""
    if isinstance(old, dict) and isinstance(new, dict):
        differ = [f"{place}.{k}: is missing" for k in old if k not in new]
        added = [f"{place}.{k}" for k in new if k not in old]
        for k in old.keys() & new.keys():
            more, keys = json_differences(old[k], new[k], f"{place}.{k}")
            differ, added = differ + more, added + keys
        return differ, added
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        found = [json_differences(a, b, f"{place}[{i}]") for i, (a, b) in enumerate(zip(old, new))]
        return sum((f[0] for f in found), []), sum((f[1] for f in found), [])
    return ([] if old == new else [f"{place}: {old} became {new}"]), []


def array_differences(old, new):
    """Arrays of two archives that differ, and keys that only the new metadata have."""
    with zipfile.ZipFile(old) as a, zipfile.ZipFile(new) as b:
        names = sorted(a.namelist())
        if names != sorted(b.namelist()):
            return [f"arrays {names} became {sorted(b.namelist())}"], []
        differ = [n for n in names if n != "meta.npy" and a.read(n) != b.read(n)]
        metas = []
        for archive in (a, b):
            bytes_ = archive.read("meta.npy")
            length = int.from_bytes(bytes_[8:10], "little")
            metas.append(renamed(json.loads(bytes_[10 + length:])))
        more, added = json_differences(*metas, place="meta")
        return differ + more, added


def number_differences(old, new):
    """Cells of two CSV files that differ by more than the tolerance."""
    rows = [[line.split(",") for line in path.read_text().splitlines()] for path in (old, new)]
    if [len(r) for r in rows[0]] != [len(r) for r in rows[1]]:
        return ["the tables differ in shape"]
    differ = []
    for line, (a, b) in enumerate(zip(*rows), start=1):
        for x, y in zip(a, b):
            try:
                same = math.isclose(float(x), float(y), rel_tol=TOLERANCE, abs_tol=TOLERANCE)
            except ValueError:
                same = x == y
            if not same:
                differ.append(f"line {line}: {x} became {y}")
    return differ


def without_header(path):
    lines = path.read_text().splitlines()
    return lines[1:] if lines and lines[0] == "x,y,z" else lines


def compare(old, new):
    """Differences between two files of one name, and keys that were added; `None` if not compared."""
    if old.name == "search.json" or old.suffix in {".png", ".3mf"}:
        return None
    if old.name == "pattern.csv":
        return ([] if without_header(old) == without_header(new) else ["the dots differ"]), []
    if old.suffix == ".npz":
        return array_differences(old, new)
    if old.suffix == ".json":
        return json_differences(*(renamed(json.loads(p.read_text())) for p in (old, new)))
    if old.name == "estimate.csv":
        return number_differences(old, new), []
    return ([] if old.read_bytes() == new.read_bytes() else ["the bytes differ"]), []


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("old", type=pathlib.Path)
    parser.add_argument("new", type=pathlib.Path)
    parser.add_argument("--objectives", default="mean-nn,whitened-nn,confusion")
    parser.add_argument("--keep", type=pathlib.Path, help="leave the files in this folder")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as aside:
        root = (arguments.keep or pathlib.Path(aside)).resolve()
        folders = [root / "old", root / "new"]
        pattern = (pathlib.Path(__file__).parent / "../designs/dots20/pattern.csv").read_text()
        objectives = arguments.objectives.split(",")
        for binary, folder in zip((arguments.old, arguments.new), folders):
            folder.mkdir(parents=True)
            produce(str(binary.resolve()), folder, objectives, pattern)
        files = [sorted(p.relative_to(f) for p in f.rglob("*") if p.is_file()) for f in folders]
        failed = 0
        for name in sorted(set(files[0]) ^ set(files[1])):
            failed += 1
            print(f"{name}: only in one")
        for name in sorted(set(files[0]) & set(files[1])):
            found = compare(*(f / name for f in folders))
            if found is None:
                continue
            differ, added = found
            failed += bool(differ)
            print(f"{name}: {'; '.join(differ[:3]) or 'same'}"
                  + (f" ({len(differ)} differences)" if len(differ) > 3 else "")
                  + (f"; new keys: {', '.join(sorted(set(added)))}" if added else ""))
    print(f"{failed} of {len(set(files[0]) | set(files[1]))} files differ")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
