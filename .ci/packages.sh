#!/usr/bin/env bash
# Wheel and sdist: built, installed in an environment of their own, and started outside the checkout.
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

python3 -m venv "$work/build"
"$work/build/bin/pip" install --quiet build
rm -rf dist
"$work/build/bin/python" -m build --outdir dist . >"$work/build.log" 2>&1 || { cat "$work/build.log"; exit 1; }

python3 -m venv "$work/venv"
for package in dist/*.whl dist/*.tar.gz; do
  echo "-- $package"
  "$work/venv/bin/pip" install --quiet --force-reinstall --no-deps "$root/$package"
  "$work/venv/bin/pip" install --quiet "$root/$package"
  (cd "$work" && "$work/venv/bin/python" -c 'import control; assert "site-packages" in control.__file__, control.__file__')
  (cd "$work" && "$work/venv/bin/python" "$root/.ci/smoke.py")
done
