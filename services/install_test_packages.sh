#!/usr/bin/env bash
# Install missing Debian packages for the tests, as root or through sudo.
# Usage: services/install_test_packages.sh PACKAGE...
set -euo pipefail
# The command or file that shows that a package is installed, also on other systems.
declare -A command=([mosquitto]=mosquitto [mosquitto-clients]=mosquitto_sub [chromium]=chromium
  [docker.io]=dockerd [docker-compose]=docker-compose [debootstrap]=debootstrap
  [iproute2]=ip [iptables]=iptables [gcc]=gcc [libc6-dev]=/usr/include/stdio.h
  [postgresql]=initdb [etcd-server]=etcd [softhsm2]=softhsm2-util
  [openjdk-17-jre-headless]=java [influxdb]=influxd [prometheus]=prometheus
  [prometheus-alertmanager]=prometheus-alertmanager
  [gcc-arm-none-eabi]=arm-none-eabi-gcc [libnewlib-arm-none-eabi]=/usr/lib/arm-none-eabi/newlib/libc.a
  [qemu-system-arm]=qemu-system-arm
  [postgresql-server-dev-15]=/usr/include/postgresql/15/server/postgres.h [libssl-dev]=/usr/include/openssl/ssl.h
  [libkrb5-dev]=/usr/include/gssapi/gssapi.h [liblz4-dev]=/usr/include/lz4.h [libzstd-dev]=/usr/include/zstd.h)
missing=()
for package in "$@"; do
  [ -e "${command[$package]}" ] || PATH=$PATH:/usr/sbin:/sbin:/usr/lib/postgresql/15/bin command -v "${command[$package]}" >/dev/null ||
    missing+=("$package")
done
[ ${#missing[@]} -eq 0 ] && exit 0

echo "Installing ${missing[*]} ..."
if ! command -v apt-get >/dev/null; then
  echo "The tests need ${missing[*]}; install them with this system's package manager." >&2
  exit 1
fi
as_root=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null || { echo "Run as root: apt-get install ${missing[*]}" >&2; exit 1; }
  as_root=(sudo)
fi
export DEBIAN_FRONTEND=noninteractive
# Packages must not start services of their own: the tests run theirs, on free ports.
policy=/usr/sbin/policy-rc.d
if [ ! -e "$policy" ]; then
  trap '"${as_root[@]}" rm -f "$policy"' EXIT
  printf '#!/bin/sh\nexit 101\n' | "${as_root[@]}" tee "$policy" >/dev/null
  "${as_root[@]}" chmod +x "$policy"
fi
"${as_root[@]}" apt-get -qq update
"${as_root[@]}" apt-get -qq install -y --no-install-recommends "${missing[@]}" >/dev/null
