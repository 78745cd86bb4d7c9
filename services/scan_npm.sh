#!/usr/bin/env bash
# Look the npm packages that a folder's lock file names up among known vulnerabilities.
# Exit status 1 if there are some. Where the registry serves no advisories, or cannot be reached,
# print that nothing was scanned, and exit with 0.
# Usage: services/scan_npm.sh FOLDER
set -euo pipefail
folder=$1
here=$(cd "$(dirname "$0")" && pwd)
if [ ! -f "$here/../$folder/package-lock.json" ]; then
  echo "$folder: there is no package-lock.json to scan" >&2
  exit 1
fi
audit() { "$here/npm.sh" "$folder" audit --package-lock-only "$@"; }

status=0
said=$(audit --json 2>&1) || status=$?
if ! grep -q '"auditReportVersion"' <<<"$said"; then
  why=$(grep -m1 -oE '"(message|summary|code)": *"[^"]+"' <<<"$said" || head -n 1 <<<"$said")
  echo "$folder: NOT SCANNED: the npm registry gives no advisories ($why)" >&2
  exit 0
fi
if [ "$status" -ne 0 ]; then
  audit || exit 1
fi
echo "$folder: no known vulnerabilities in package-lock.json"
