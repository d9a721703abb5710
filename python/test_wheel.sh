#!/usr/bin/env bash
# Builds the wheel, installs it into a fresh environment, and tests it there: types, examples, pytest.
# Needs Rust, Python 3.10 or later, and PyPI. `WHEELS=DIR` keeps the wheel there. Exits 77 where no
# environment can be made: nothing was tested then.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
venv=$(mktemp -d)
trap 'rm -rf "$venv"' EXIT
nothing_tested() {
  echo "the Python package is NOT tested: $1" >&2
  exit 77
}
if ! python3 -m venv "$venv/env" 2> "$venv/why"; then
  # Debian and Ubuntu have it in a package of its own, python3-venv.
  echo "python3 -m venv does not work here: trying virtualenv" >&2
  rm -rf "$venv/env"
  python3 -m pip install --quiet --target "$venv/tools" virtualenv || nothing_tested "no venv, no virtualenv"
  PYTHONPATH="$venv/tools" python3 -m virtualenv --quiet "$venv/env" || nothing_tested "no environment"
fi
bin=$venv/env/bin
pip=("$bin/python" -m pip --quiet --disable-pip-version-check)
wheels=${WHEELS:-$venv/wheels}
mkdir -p "$wheels"
"${pip[@]}" install "maturin>=1.16,<2" uv || nothing_tested "PyPI cannot be reached"
(cd "$here" && "$bin/maturin" build --quiet --release --compression-level 9 --out "$wheels")
wheel=$(ls -t "$wheels"/spindoe-*.whl | head -n 1)
bytes=$(stat -c %s "$wheel")
echo "$(basename "$wheel"): $bytes bytes"
[ "$bytes" -le 8600000 ] || { echo "expected at most 8.6 MB" >&2; exit 1; }
# `uv` takes a seventh of the time; what only pip's settings know, an index of one's own, pip finds.
"$bin/uv" pip install --quiet --python "$bin/python" "$wheel[test]" || "${pip[@]}" install "$wheel[test]"
(cd "$here" && "$bin/mypy" --cache-dir "$venv/mypy" spindoe spindoe_compat spindoe_ros examples/*.py)
# Not from the folder that holds the sources: what is tested is the wheel.
cd "$venv"
"$bin/pytest" -q -rs -n 2 --durations=15 -p no:cacheprovider -c "$here/pyproject.toml" --rootdir "$here" "$here/tests"
