#!/bin/sh
# Enrol the gateway and its site, then run. Each has the name of its folder.
set -eu
identity=${ESKIN_IDENTITY_DIRECTORY:-/var/lib/eskin/gateway.g1}
site=${ESKIN_IDENTITY_SITE:-/var/lib/eskin/site.main}
enrol gateway "${identity##*/}" "$identity"
enrol site "${site##*/}" "$site"
exec "$@"
