#!/bin/sh
# Make one cluster of running servers; done again, it changes nothing.
# Usage: join.sh COORDINATOR WORKER...: the ports that name their sockets
set -eu
export PGOPTIONS=--client-min-messages=warning
ask() {
  psql --no-psqlrc --quiet --no-align --tuples-only --set ON_ERROR_STOP=1 --host /run/database --port "$1" --username postgres \
    --dbname eskin --command "$2" >/dev/null
}
for port in "$@"; do
  ask "$port" "CREATE EXTENSION IF NOT EXISTS citus"
done
coordinator=$1
shift
ask "$coordinator" "SELECT citus_set_coordinator_host('/run/database', $coordinator)"
for worker in "$@"; do
  ask "$coordinator" "SELECT citus_add_node('/run/database', $worker)"
done
