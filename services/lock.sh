#!/bin/sh
# Write requirements.lock: one version of each direct and indirect dependency of all extras and of the build, with the
# hashes of its files for every platform and Python.
# Versions in the lock stay, unless --upgrade or --upgrade-package NAME is given.
set -eu
cd "$(dirname "$0")/.."
env=$(mktemp -d)
trap 'rm -rf "$env"' EXIT
python3 -m venv "$env"
"$env/bin/pip" install --quiet --disable-pip-version-check 'uv>=0.8'
python3 -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["build-system"]["requires"], sep="\n")' \
  >"$env/build.in"
"$env/bin/uv" pip compile pyproject.toml "$env/build.in" --all-extras --universal --python-version 3.11 \
  --generate-hashes --no-header --quiet --output-file requirements.lock "$@"
sed -i "s|# via -r $env/build.in|# via eskin (build-system)|; s|#   -r $env/build.in|#   eskin (build-system)|" requirements.lock
