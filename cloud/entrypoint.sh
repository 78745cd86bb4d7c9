#!/bin/sh
# Enrol the cloud, which one of several names by ESKIN_CLOUD_NAME, then run.
set -eu
enrol server "${ESKIN_CLOUD_NAME:-server.cloud}" /var/lib/eskin/identity
exec "$@"
