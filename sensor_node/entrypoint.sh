#!/bin/sh
# Enrol the node named by ESKIN_NODE_NAME, fetch the certificate of its site, then run.
set -eu
enrol node "$ESKIN_NODE_NAME" /var/lib/eskin/identity
[ -e /var/lib/eskin/site.pem ] ||
  eskin pki fetch --url https://ca:8444 --enrol-dir /enrol --name site.main \
    --out /var/lib/eskin/site.pem
exec "$@"
