#!/bin/sh
# Make the database where there is none yet, then run.
set -eu
data=/var/lib/eskin/data
if [ ! -d "$data" ]; then
  # Renamed only when it is complete: an interrupted start begins again.
  rm -rf "$data.new"
  initdb --pgdata "$data.new" --username postgres --auth reject --encoding UTF8 --locale C.UTF-8 \
    --no-instructions
  printf '%s\n' 'CREATE ROLE eskin LOGIN' 'CREATE DATABASE eskin OWNER eskin' |
    postgres --single -D "$data.new" postgres
  mv "$data.new" "$data"
fi
exec "$@"
