#!/usr/bin/env bash
# Make .venv with the exact versions of constraints.txt and this project in it. Done again only when something changed.
set -euo pipefail
cd "$(dirname "$0")/.."

say() { printf 'setup: %s\n' "$*" >&2; }
die() { say "$*"; exit 1; }

python=${PYTHON:-python3}
command -v "$python" >/dev/null || die "$python is not installed; apt-get install python3 python3-venv, or PYTHON=... make setup"
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
  die "$("$python" --version) is too old; give one >= 3.11: PYTHON=python3.12 make setup"

# torch: what pip would take anyway, but exactly this version and before all else, so that no dependency brings
# another one. TORCH overrides it, e.g. TORCH=torch==2.13.0+cu130 where your package index has such builds.
torch=${TORCH:-$(grep '^torch==' constraints.txt)}

gpu=no; nvidia-smi -L >/dev/null 2>&1 && gpu=yes
stamp=.venv/.setup
state=$(cat constraints.txt pyproject.toml scripts/setup.sh | cksum; echo "$torch $gpu"; "$python" --version; pwd)
if [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$state" ]; then exit 0; fi

# What open3d's wheel expects of a Debian or Ubuntu system; without them everything but the ray-cast demo scene runs.
missing=()
while IFS=: read -r library package; do
  ldconfig -p 2>/dev/null | grep -q "$library" || missing+=("$package")
done < <(sed -n 's/^    "\(lib[^"]*\)": "\([^"]*\)",$/\1:\2/p' sucre_bench/programs/doctor.py)
if [ ${#missing[@]} -gt 0 ] && command -v apt-get >/dev/null; then
  if [ "$(id -u)" = 0 ]; then
    say "installing ${missing[*]}"
    { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"; } >/dev/null ||
      say "could not install ${missing[*]}; the demo scene needs them"
  else
    say "the demo scene needs: sudo apt-get install -y ${missing[*]}"
  fi
fi

if ! [ -x .venv/bin/python ] || ! .venv/bin/python -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
  rm -rf .venv
  "$python" -m venv .venv || { rm -rf .venv; die "no venv module; apt-get install python3-venv"; }
fi
pip() { PIP_USE_PEP517=1 .venv/bin/python -m pip --disable-pip-version-check "$@"; }
say "installing into .venv (a few minutes the first time)"
pip install --quiet -c constraints.txt "$torch"
pip install --quiet -c constraints.txt -e '.[dev]'
if [ "$gpu" = yes ] && ! .venv/bin/python -c 'import torch, sys; sys.exit(not torch.cuda.is_available())'; then
  say "there is a GPU, but this torch does not see it; TORCH=torch==... make setup with a CUDA build for your driver"
fi
echo "$state" >"$stamp"
