"""What each constant of a room (`src/vision`, `src/calibrate`) decides: right and wrong answers as it is scaled.

    python studies/constants/sweep.py vision WORK OUT.csv [--frames 120] [--only pose::]
    python studies/constants/sweep.py calibrate WORK OUT.csv

WORK becomes a copy of the sources in which every constant of the room is a function of a factor that is set at run time. What does
not compile so (lengths of arrays, other constants) stays a constant. One build, and then one estimate of the same rendered pictures, or
one table of the same clips of unknown balls, for each constant and factor. `table.py` makes the page of OUT.csv.
"""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ROOM = Path("src") / sys.argv[1]
HERE = Path(__file__).parent
CONST = re.compile(r"^(?P<vis>pub(?:\([a-z: ]+\))? )?const (?P<name>[A-Z0-9_]+): (?P<type>[^=]+?) =\s*(?P<value>[^;]+);", re.M)
REGISTRY = """//! Constants by number, and by how much one of them is scaled.

use std::sync::atomic::{{AtomicU64, AtomicUsize, Ordering::Relaxed}};

/// All.
pub static NAMES: &[&str] = &{names};
static WHICH: AtomicUsize = AtomicUsize::new(usize::MAX);
static FACTOR: AtomicU64 = AtomicU64::new(0);

/// Scales one.
pub fn scale(which: usize, factor: f64) {{
    FACTOR.store(factor.to_bits(), Relaxed);
    WHICH.store(which, Relaxed);
}}

/// The factor of one.
#[inline(always)]
pub fn factor(which: usize) -> f64 {{
    match WHICH.load(Relaxed) == which {{
        true => f64::from_bits(FACTOR.load(Relaxed)),
        false => 1.0,
    }}
}}

/// A number of things: at least one more or one less.
#[inline(always)]
pub fn count(which: usize, value: usize) -> usize {{
    let factor = factor(which);
    let scaled = (value as f64 * factor).round() as usize;
    match factor {{
        f if f > 1.0 => scaled.max(value + 1),
        f if f < 1.0 => scaled.min(value.saturating_sub(1)),
        _ => value,
    }}
}}
"""


def scaled(kind: str, value: str, number: int) -> str | None:
    """The value as it is scaled; None where that means nothing."""
    if kind == "f64":
        return f"({value}) * crate::sweep::factor({number})"
    if kind == "f32":
        return f"({value}) * crate::sweep::factor({number}) as f32"
    if kind == "usize":
        return f"crate::sweep::count({number}, {value})"
    if re.fullmatch(r"\[f64; \d+\]", kind):
        return f"({value}).map(|x: f64| x * crate::sweep::factor({number}))"
    return None


def files() -> list[Path]:
    return sorted(p.relative_to(ROOT) for p in (ROOT / ROOM).rglob("*.rs") if p.name != "tests.rs")


def rewrite(work: Path, kept: set[str]) -> list[str]:
    """Writes the sources with all constants but those of `kept` as functions; their names."""
    names: list[str] = []
    for path in files():
        text = (ROOT / path).read_text()
        head, mark, tests = text.partition("#[cfg(test)]")
        module = str(path.relative_to(ROOM)).removesuffix(".rs").replace("/", "::")
        for found in list(CONST.finditer(head)):
            name, full = found["name"], f"{module}::{found['name']}"
            if found["vis"] or full in kept:
                continue
            value = scaled(found["type"], found["value"], len(names))
            if value is None:
                continue
            head = head.replace(found[0], f"@@{len(names)}@@")
            used = re.compile(rf"(?<![\w:.]){name}\b(?!\s*:)")
            head, tests = used.sub(f"{name}()", head), used.sub(f"{name}()", tests)
            function = f"#[allow(non_snake_case)]\n#[inline(always)]\nfn {name}() -> {found['type']} {{\n    {value}\n}}"
            head = head.replace(f"@@{len(names)}@@", function)
            names.append(full)
        (work / path).write_text(head + mark + tests)
    (work / "src/sweep.rs").write_text(REGISTRY.format(names=json.dumps(names)))
    return names


def failing(work: Path, names: list[str]) -> set[str]:
    """Constants that must stay some, by the compiler's errors."""
    command = ["cargo", "check", "--lib", "--message-format=json", "--quiet"]
    done = subprocess.run(command, cwd=work, capture_output=True, text=True)
    found: set[str] = set()
    for line in done.stdout.splitlines():
        message = json.loads(line).get("message") or {}
        if message.get("level") != "error":
            continue
        for span in message.get("spans", []):
            path = Path(span["file_name"])
            if not path.is_relative_to(ROOM):
                continue
            module = str(path.relative_to(ROOM)).removesuffix(".rs").replace("/", "::")
            words = set(re.findall(r"\b[A-Z][A-Z0-9_]*\b", " ".join(t["text"] for t in span["text"])))
            here = {n for n in names if n.rsplit("::", 1)[0] == module}
            hit = {n for n in here if n.rsplit("::", 1)[1] in words}
            found |= hit or {n for n in names if n.rsplit("::", 1)[1] in words} or here
    if done.returncode and not found:
        sys.exit(done.stdout[-3000:] + done.stderr[-3000:])
    return found


def main() -> None:
    work, out = Path(sys.argv[2]), Path(sys.argv[3])
    skip = shutil.ignore_patterns("target", ".git")
    shutil.copytree(ROOT, work, ignore=skip, dirs_exist_ok=True)
    library = work / "src/lib.rs"
    library.write_text((ROOT / "src/lib.rs").read_text().replace("pub mod stencil;", "pub mod stencil;\n#[allow(missing_docs)]\npub mod sweep;"))
    program = work / "studies/src/bench/main.rs"
    text = (ROOT / "studies/src/bench/main.rs").read_text()
    text = text.replace("mod targets;", "mod sweep;\nmod targets;").replace("    Targets(", "    /// Constants.\n    Sweep(sweep::Args),\n    Targets(")
    program.write_text(re.sub(r"( +)(Command::)?Targets\(args\)", r"\1\2Sweep(args) => args.run(),\n\1\2Targets(args)", text))
    shutil.copy(HERE / f"judge_{ROOM.name}.rs", work / "studies/src/bench/sweep.rs")
    kept: set[str] = set()
    while True:
        names = rewrite(work, kept)
        more = failing(work, names)
        if not more:
            break
        kept |= more
        print(f"{len(more)} stay constants", flush=True)
    print(f"{len(names)} are scaled, {len(kept)} stay constants", flush=True)
    command = ["cargo", "build", "--release", "--quiet", "-p", "spindoe-studies"]
    subprocess.run(command, cwd=work, check=True)
    with out.open("w") as file:
        subprocess.run([work / "target/release/bench", "sweep", *sys.argv[4:]], cwd=work, stdout=file, check=True)


main()
