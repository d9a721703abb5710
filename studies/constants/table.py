"""The page of what constants decide: `docs/measurements/constants.md`, by a sweep's file.

    python studies/constants/table.py vision OUT.csv [OUT.csv ...]
    python studies/constants/table.py calibrate OUT.csv [OUT.csv ...]

Each file is compared with its own first row, where no constant is scaled; what stands in two is taken from the later one.
"""

import csv
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/measurements/constants.md"
ROOM = sys.argv[1]
BEGIN, END = f"<!-- {ROOM} -->", f"<!-- end of {ROOM} -->"
SUMMARY = {
    "vision": "{right} right, {wrong} wrong, {others} answered without the ball, of {judged} pictures.",
    "calibrate": "{right} whole tables, {wrong} wrong ones, of {judged} clips; {others} dots in them.",
}


def value(name: str) -> str:
    """As the source has it."""
    module, _, constant = name.rpartition("::")
    path = ROOT / "src" / ROOM / (module.replace("::", "/") + ".rs")
    found = re.search(rf"const {constant}: [^=]+=\s*([^;]+);", path.read_text())
    return " ".join(found[1].split()) if found else "?"


def change(run: dict[str, str], base: dict[str, str]) -> tuple[list[int], float]:
    counts = [int(run[k]) - int(base[k]) for k in ("right", "wrong", "others")]
    mean = [float(r["sum_of_errors_deg"]) / max(int(r["right"]), 1) for r in (run, base)]
    return counts, 100.0 * (mean[0] / mean[1] - 1.0)


def words(counts: list[int], mean: float) -> str:
    if not any(counts) and abs(mean) < 0.05:
        return "="
    shown = ", ".join(f"{n:+d}" if n else "0" for n in counts)
    return f"{shown}; {mean:+.1f} %"


def main() -> None:
    base: dict[str, str] = {}
    by_name: dict[str, dict[float, str]] = {}
    for path in sys.argv[2:]:
        with Path(path).open(newline="") as file:
            rows = list(csv.DictReader(file))
        base = rows[0]
        for row in rows:
            if row["constant"] != "none":
                by_name.setdefault(row["constant"], {})[float(row["factor"])] = words(*change(row, base))
    factors = sorted({f for runs in by_name.values() for f in runs})
    lines = [
        SUMMARY[ROOM].format(**base),
        "",
        "| constant | value | " + " | ".join(f"x {f:g}" for f in factors) + " |",
        "|---|---|" + "---|" * len(factors),
    ]
    same: list[str] = []
    for name, runs in sorted(by_name.items()):
        cells = [runs.get(f, "-") for f in factors]
        if all(cell == "=" for cell in cells):
            same.append(name)
            continue
        lines.append(f"| `{name}` | {value(name)} | " + " | ".join(cells) + " |")
    lines += ["", f"Without an effect here, {len(same)} of {len(by_name)}: " + ", ".join(f"`{n}`" for n in sorted(same)) + "."]
    text = PAGE.read_text()
    head, rest = text.split(BEGIN)
    _, tail = rest.split(END)
    PAGE.write_text(head + BEGIN + "\n\n" + "\n".join(lines) + "\n\n" + END + tail)


main()
