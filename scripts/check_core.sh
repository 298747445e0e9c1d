#!/usr/bin/env bash
# What people get: the wheel, built from the source distribution and installed alone, without extras, in a fresh environment
# outside of this folder. Then the main commands, and tests of what rests most on Python and the libraries.
#   KEEP=1 scripts/check_core.sh    keeps the environment, and says where
set -euo pipefail
cd "$(dirname "$0")/.."
python=$PWD/.venv/bin/python here=$PWD
rm -rf dist
"$python" -m build --no-isolation --outdir dist . >/dev/null
"$python" -m twine check --strict dist/*

work=$(mktemp -d)
if [ -z "${KEEP:-}" ]; then trap 'rm -rf "$work"' EXIT; fi
"$python" -m venv --without-pip "$work/venv"
install() { "$python" "$here/scripts/uv_like_pip.py" --python "$work/venv/bin/python" -c "$here/constraints.txt" --quiet "$@"; }
cd "$work"
install "$(echo "$here"/dist/*.whl)"
echo "the core: $(du -sm "$work/venv" | cut -f1) MB"

bench=$work/venv/bin/sucre-bench
"$bench" doctor
# README's commands as typed; `restore` needs an extra, which README installs before it.
export PATH="$work/venv/bin:$PATH"
grep -E '^sucre-bench (run|compare)' "$here/README.md" | bash -e
mv results/restored/demo/gray_world restored
printf 'image,UCIQE\nview_000.png,0.5\n' >published.csv
grep '^sucre-bench score' "$here/README.md" | bash -e

install pytest pytest-xdist hypothesis
cd "$here"
# Not `python -m pytest`, which would find this folder's package instead of the installed one.
"$work/venv/bin/pytest" -n auto --dist loadfile -m short tests/test_errors.py tests/compare tests/machine tests/engine
if [ -n "${KEEP:-}" ]; then echo "kept: $work"; fi
