#!/usr/bin/env bash
# Builds the wheel and runs tests/smoke_test.py on it in a clean environment that holds only the core dependencies.
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# Built from a copy of what git tracks, so that a stray file or an old build folder cannot hide a missing one.
mkdir "$work/source"
git ls-files -z | xargs -0 tar cf - | tar xf - -C "$work/source"
.venv/bin/python -m build -q --wheel --outdir "$work/dist" "$work/source"
.venv/bin/python -m venv "$work/venv"
"$work/venv/bin/python" -m pip install -qq --disable-pip-version-check "$work"/dist/*.whl -c constraints.txt
cd "$work" # away from the checkout, so that what is imported is the wheel
"$work/venv/bin/python" "$root/tests/smoke_test.py" "$root"
ls -l "$work/dist"
