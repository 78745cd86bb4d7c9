#!/bin/sh
# Install the dependencies that requirements.lock pins into a virtual environment, checked by hash, then eskin itself,
# editable. With --only, install the extras and not eskin.
# Usage: services/install.sh VENV [--only] EXTRA...
set -eu
cd "$(dirname "$0")/.."
venv=$1
shift
wanted=$(mktemp)
trap 'rm -f "$wanted"' EXIT
"$venv/bin/python" services/image/requirements.py "$@" >"$wanted"
"$venv/bin/pip" install --disable-pip-version-check --require-hashes --no-deps --requirement "$wanted"
case " $* " in
*" --only "*) ;;
*) "$venv/bin/pip" install --disable-pip-version-check --no-deps --no-build-isolation --editable . ;;
esac
