#!/bin/sh
# Enrol an MQTT client, then subscribe with mosquitto_sub's options.
set -eu
identity=/var/lib/eskin/identity
enrol client client.demo "$identity" >&2
exec mosquitto_sub -h broker -p 8885 \
  --cafile "$identity/root.pem" --cert "$identity/chain.pem" --key "$identity/key.pem" "$@"
