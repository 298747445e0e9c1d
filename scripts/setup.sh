#!/usr/bin/env bash
# Make .venv with the exact versions of constraints.txt and this project in it. Done again only when something changed.
#   PYTHON=python3.13 scripts/setup.sh    another Python; the next set-up keeps it
#   TORCH=torch==2.13.0+cu130 ...         another build of PyTorch, where your package index has it
#   VENV=.venv-3.13 ...                   another folder
set -euo pipefail
cd "$(dirname "$0")/.."

say() { printf 'setup: %s\n' "$*" >&2; }
die() { say "$*"; exit 1; }
recent() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }
version() { "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])'; }

venv=${VENV:-.venv}
discard() {
  [ ! -e "$venv" ] || [ -L "$venv" ] || [ -f "$venv/pyvenv.cfg" ] || die "$venv is no virtual environment; VENV=... names another folder"
  rm -rf "$venv"
}
# An environment that was moved has programs that start a Python which is not there any more.
if ! recent "$venv/bin/python" || ! [ -x "$(sed -n '1s/^#!//p' "$venv/bin/pip" 2>/dev/null)" ]; then discard; fi
python=${PYTHON:-$([ -x "$venv/bin/python" ] && echo "$venv/bin/python" || echo python3)}
command -v "$python" >/dev/null || die "$python is not installed; apt-get install python3 python3-venv, or PYTHON=... make setup"
recent "$python" || die "$("$python" --version 2>&1 | tail -1) is too old; give one >= 3.11: PYTHON=python3.12 make setup"
if [ -x "$venv/bin/python" ] && [ "$(version "$python")" != "$(version "$venv/bin/python")" ]; then discard; fi

gpu=no; nvidia-smi -L >/dev/null 2>&1 && gpu=yes
stamp=$venv/.setup
state=$(cat constraints.txt pyproject.toml scripts/* | cksum; echo "${TORCH:-} $gpu"; version "$python"; pwd)
if [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$state" ]; then exit 0; fi

# What open3d's wheel expects of a Debian or Ubuntu system; without them everything but surfaces runs.
missing=()
libraries=$(PATH=$PATH:/usr/sbin:/sbin ldconfig -p 2>/dev/null || true)
while IFS=: read -r library package; do
  [[ $libraries == *"$library"* ]] || missing+=("$package")
done < <(sed -n 's/^    "\(lib[^"]*\)": "\([^"]*\)",$/\1:\2/p' sucre_bench/programs/doctor.py)
if [ ${#missing[@]} -gt 0 ] && command -v apt-get >/dev/null; then
  if [ "$(id -u)" = 0 ]; then
    say "installing ${missing[*]}"
    { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -o DPkg::Lock::Timeout=120 -y -qq --no-install-recommends "${missing[@]}"; } >/dev/null ||
      say "could not install ${missing[*]}; surfaces need them"
  else
    say "surfaces (prepare) need: sudo apt-get install -y ${missing[*]}"
  fi
fi

if ! [ -x "$venv/bin/python" ]; then
  say "making $venv with $("$python" --version)"
  "$python" -m venv "$venv" || { rm -rf "$venv"; die "no venv module; apt-get install python3-venv"; }
fi
rm -f "$stamp"

# TORCH replaces the pinned version, whichever it is.
pins=constraints.txt
if [ -n "${TORCH:-}" ]; then
  pins=$venv/constraints.txt
  grep -v '^torch==' constraints.txt >"$pins"
fi
torch=${TORCH:-$(grep '^torch==' constraints.txt)}

# On a terminal, uv and pip show how far they are. In a log, a line for every package that is there would hide the rest.
shown() {
  if [ -t 2 ]; then "$@" >&2; else "$@" 2>&1 | sed -u '/^ [-+~] /d; /^Requirement already satisfied/d' >&2; fi
}
uv=("$venv/bin/python" scripts/uv_like_pip.py -c "$pins")
# PyTorch's own index has builds for CPUs alone and for each CUDA, and uv finds out which one this machine needs.
# Asked once, without patience: many networks do not reach it, and then pip's settings decide.
pytorch_index_answers() {
  [ -z "${TORCH:-}${UV_TORCH_BACKEND:-}" ] && UV_HTTP_RETRIES=0 UV_HTTP_CONNECT_TIMEOUT=5 timeout 20 \
    "${uv[@]}" --quiet --dry-run --reinstall --no-deps --torch-backend=auto "$torch" >/dev/null 2>&1
}
with_uv() {
  "$venv/bin/python" -m pip --disable-pip-version-check install --quiet -c "$pins" uv 2>/dev/null || return 1
  local install=("${uv[@]}" "$torch" -e '.[dev]')
  if pytorch_index_answers && shown "${install[@]}" --torch-backend=auto; then return 0; fi
  shown "${install[@]}"
}
# torch before all else, so that no dependency brings another one.
with_pip() {
  local install=("$venv/bin/python" -m pip --disable-pip-version-check install -c "$pins")
  export PIP_USE_PEP517=1
  shown "${install[@]}" "$torch" && shown "${install[@]}" -e '.[dev]'
}
say "installing into $venv, about 4 GB"
with_uv || { say "uv cannot install this; pip tries, which takes minutes"; with_pip; } ||
  die "could not install the packages; the reason is above"
if [ "$gpu" = yes ] && ! "$venv/bin/python" -c 'import torch, sys; sys.exit(not torch.cuda.is_available())'; then
  say "there is a GPU, but this torch does not see it; TORCH=torch==... make setup with a CUDA build for your driver"
fi
# Python compiles a package when it is first imported. Where that is not kept (PYTHONDONTWRITEBYTECODE, as in many Docker
# images) every start would take seconds longer, so what sucre_bench imports is compiled now: a sixth of all files.
if [ -n "${PYTHONDONTWRITEBYTECODE:-}" ]; then
  say "compiling what sucre_bench imports"
  env -u PYTHONDONTWRITEBYTECODE "$venv/bin/sucre-bench" doctor >/dev/null 2>&1 || say "$venv/bin/sucre-bench doctor finds faults"
  # doctor opens no store of mlflow
  env -u PYTHONDONTWRITEBYTECODE MLFLOW_DISABLE_TELEMETRY=true "$venv/bin/python" -c 'import mlflow
mlflow.MlflowClient("sqlite://").search_experiments()' >/dev/null 2>&1 || true
fi
echo "$state" >"$stamp"
