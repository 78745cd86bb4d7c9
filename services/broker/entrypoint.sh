#!/bin/sh
# Enrol the broker and the client that checks its health, then run under a guard,
# which fetches whom each listener trusts, and renews.
set -eu
enrol server server.broker /var/lib/eskin/identity
enrol client client.health /var/lib/eskin/client.health
mkdir -p -m 0700 /var/lib/eskin/anchors
exec eskin pki guard --url https://ca:8444 --identity /var/lib/eskin/identity \
  --also /var/lib/eskin/client.health --folder /var/lib/eskin/anchors -- "$@"
