#!/usr/bin/env bash
# Builds the wheel, installs it into a fresh environment, and tests it there: types, examples, pytest.
# Needs Rust, Python 3.10 or later, and PyPI. `WHEELS=DIR` keeps the wheel there.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
venv=$(mktemp -d)
trap 'rm -rf "$venv"' EXIT
python3 -m venv "$venv"
pip=("$venv/bin/python" -m pip --quiet --disable-pip-version-check)
wheels=${WHEELS:-$venv/wheels}
mkdir -p "$wheels"
"${pip[@]}" install "maturin>=1.9.4,<2"
(cd "$here" && "$venv/bin/maturin" build --quiet --release --out "$wheels")
wheel=$(ls -t "$wheels"/spindoe-*.whl | head -n 1)
bytes=$(stat -c %s "$wheel")
echo "$(basename "$wheel"): $bytes bytes"
[ "$bytes" -le 8000000 ] || { echo "expected at most 8 MB" >&2; exit 1; }
"${pip[@]}" install "$wheel[test]"
(cd "$here" && "$venv/bin/mypy" --cache-dir "$venv/mypy" spindoe examples/*.py)
# Not from the folder that holds the sources: what is tested is the wheel.
cd "$venv"
bin/pytest -q -p no:cacheprovider -c "$here/pyproject.toml" --rootdir "$here" "$here/tests"
