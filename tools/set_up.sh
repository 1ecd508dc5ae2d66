#!/usr/bin/env bash
# Makes .venv and installs the project into it with everything that training and testing need.
# Called by the Makefile, once; needs bash and Python 3.11 or newer. PYTHON=... chooses the interpreter.
set -euo pipefail
cd "$(dirname "$0")/.."
venv=.venv

# Runs an apt-get install of the named packages where that is possible, and otherwise prints the command to run.
install_system_packages() {
    if command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; then
        echo "Installing system packages: $*"
        export DEBIAN_FRONTEND=noninteractive
        apt-get install -y -q --no-install-recommends "$@" >/dev/null 2>&1 ||
            { apt-get update -q && apt-get install -y -q --no-install-recommends "$@"; }
    else
        echo "System packages are missing. Please run: sudo apt-get install $*" >&2
        return 1
    fi
}

is_new_enough() {
    command -v "$1" >/dev/null && "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null
}

find_python() {
    local candidate
    for candidate in ${PYTHON:-python3 python3.11 python3.12 python3.13 python}; do
        if is_new_enough "$candidate"; then
            echo "$candidate"
            return
        fi
    done
    echo "Python 3.11 or newer was not found. Install it, or name it: make PYTHON=/path/to/python3.11" >&2
    return 1
}

if [ ! -x "$venv/bin/python" ]; then
    python=$(find_python)
    if ! "$python" -c 'import ensurepip' 2>/dev/null; then
        install_system_packages python3-venv # Debian splits the module that puts pip into a virtual environment
    fi
    echo "Making the virtual environment $venv with $("$python" --version)"
    "$python" -m venv "$venv"
fi

echo "Installing the packages (a few minutes the first time)"
"$venv/bin/python" -m pip install -qq --disable-pip-version-check -e '.[all,dev]' -c constraints.txt

if [ "$(uname -s)" = Linux ]; then
    missing=()
    loads() { "$venv/bin/python" -c "import ctypes; ctypes.CDLL('$1')" 2>/dev/null; }
    loads libEGL.so.1 || missing+=(libegl1)
    loads libOSMesa.so.8 || missing+=(libosmesa6)
    loads libGL.so.1 || missing+=(libgl1)
    if [ ${#missing[@]} -gt 0 ]; then
        install_system_packages "${missing[@]}"
    fi
fi
