#!/bin/sh
# Healthy is a broker that takes a client's certificate and grants it a subscription.
identity=/var/lib/eskin/client.health
exec mosquitto_sub -E -h localhost -p 8885 -t eskin/v1/live/health \
  --cafile "$identity/root.pem" --cert "$identity/chain.pem" --key "$identity/key.pem"
