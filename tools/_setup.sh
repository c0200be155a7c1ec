# Sourced by the tools beside it: makes .venv with the project in it, whatever is missing on a fresh machine.

cd "$(dirname "${BASH_SOURCE[0]}")/.."

say() { printf 'stereo-gpu: %s\n' "$*" >&2; }

# System packages need root; without it, say what to type.
install_packages() {
  if [ "$(id -u)" = 0 ]; then
    run=""
  elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
    run="sudo"
  else
    say "please run: sudo apt-get install $*"
    return 1
  fi
  say "installing $*"
  $run apt-get update -qq && DEBIAN_FRONTEND=noninteractive $run apt-get install -y -qq "$@" >/dev/null
}

find_python() {
  for name in python3 python3.13 python3.12 python3.11; do
    if "$name" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2])' 2>/dev/null; then
      command -v "$name"
      return
    fi
  done
  return 1
}

if [ ! -x .venv/bin/python ] || ! .venv/bin/python -c 'import pip' 2>/dev/null; then
  find_python >/dev/null || install_packages python3 python3-venv || exit 1
  python="$(find_python)" || { say "needs Python 3.11 or newer, and found none"; exit 1; }
  say "making .venv with $python"
  # Debian keeps the part of Python that makes environments in a package of its own.
  "$python" -m venv .venv >/dev/null 2>&1 || { install_packages python3-venv && "$python" -m venv --clear .venv; } || exit 1
fi

# PoCL links its kernels with ld; without it the OpenCL kernels cannot run and Warp's take over.
command -v ld >/dev/null || install_packages binutils || say "without ld (package binutils) OpenCL cannot run on the CPU"

# Install anew only when what is to be installed has changed.
stamp=.venv/installed
if ! cmp -s pyproject.toml "$stamp"; then
  say "installing stereo-gpu and what it needs into .venv"
  .venv/bin/python -m pip install --quiet --disable-pip-version-check -e '.[dev]' && cp pyproject.toml "$stamp" || exit 1
fi
