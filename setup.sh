#!/bin/sh
# Make a virtual environment and the system libraries that open3d loads, where that is allowed.
# usage: setup.sh PYTHON VENV
set -eu

python=$1
venv=$2

install() {  # install PACKAGE...: with apt-get if we may, else say what to run
    if ! command -v apt-get >/dev/null; then
        echo "please install the equivalents of: $*" >&2
        return 1
    elif [ "$(id -u)" = 0 ]; then
        apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "$@" >/dev/null
    elif sudo -n true 2>/dev/null; then
        sudo apt-get update -qq && sudo apt-get install -y -qq "$@" >/dev/null
    else
        echo "please run:  sudo apt-get install -y $*" >&2
        return 1
    fi
}

command -v "$python" >/dev/null || { echo "there is no $python; install Python 3.10 or newer" >&2; exit 1; }
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 10))' ||
    { echo "$("$python" -V) is too old; 3.10 or newer is needed (make PYTHON=python3.12 ...)" >&2; exit 1; }

# Debian splits ensurepip off into a package of its own.
"$python" -c 'import ensurepip, venv' 2>/dev/null || install python3-venv || exit 1
[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"

missing=""
for pair in libusb-1.0.so.0:libusb-1.0-0 libGL.so.1:libgl1 libEGL.so.1:libegl1 libgomp.so.1:libgomp1; do
    "$python" -c "import ctypes; ctypes.CDLL('${pair%%:*}')" 2>/dev/null || missing="$missing ${pair#*:}"
done
# Only meshes that need open3d fail without them, so go on after saying so.
# shellcheck disable=SC2086  one word a package
[ -z "$missing" ] || install $missing || echo "going on without$missing: open3d will not load" >&2
