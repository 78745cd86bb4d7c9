#!/usr/bin/env bash
# Build Citus 13.0 for PostgreSQL 15 from a source tree, which stays as it is.
# Usage: services/citus/build.sh SOURCE [TARGET]
#   SOURCE   Citus's source tree, such as a checkout of v13.0.5
#   TARGET   a folder that does not exist, for a copy of PostgreSQL with Citus in it; without it, Citus is installed into
#            the system's PostgreSQL (root)
# The last line of output is the folder of the server's programs. PG_CONFIG may name another pg_config than Debian's.
set -eu -o pipefail
tested=13.0
pg_config=${PG_CONFIG:-/usr/lib/postgresql/15/bin/pg_config}
say() { echo "citus: $*" >&2; }
refuse() { say "$*"; exit 2; }

[ $# -ge 1 ] && [ $# -le 2 ] || refuse "usage: services/citus/build.sh SOURCE [TARGET]"
source=$1 target=${2:-}
[ -f "$source/configure" ] && grep -q 'AC_INIT(\[Citus\]' "$source/configure.ac" 2>/dev/null ||
  refuse "$source is no source tree of Citus; check out v13.0.5 of https://github.com/citusdata/citus"
version=$(sed -nE 's/^AC_INIT\(\[Citus\], \[([^]]+)\]\)/\1/p' "$source/configure.ac")
case $version in
  "$tested".*) ;;
  *) refuse "$source is Citus $version; only $tested is tested with PostgreSQL 15: check out v13.0.5" ;;
esac
[ -z "$target" ] || [ ! -e "$target" ] || refuse "$target exists; name a folder that does not"
[ -x "$pg_config" ] || refuse "$pg_config is missing; install postgresql-15 and postgresql-server-dev-15"
case $("$pg_config" --version) in
  "PostgreSQL 15."*) ;;
  *) refuse "$("$pg_config" --version) is not tested with Citus $version; set PG_CONFIG to that of PostgreSQL 15" ;;
esac
[ -f "$("$pg_config" --includedir-server)/postgres.h" ] || refuse "PostgreSQL's headers are missing; install postgresql-server-dev-15"
for program in gcc make; do
  command -v "$program" >/dev/null || refuse "$program is missing; install $program"
done

work=$(mktemp -d)
mkdir "$work/citus"
trap 'rm -rf "$work"' EXIT
log=$work/log
step() {
  local what=$1
  shift
  say "$what ..."
  "$@" >"$log" 2>&1 || {
    grep -i 'error' "$log" | grep -v '^gcc ' | head -n 5 >&2 || tail -n 5 "$log" >&2
    refuse "$what failed; headers are in libkrb5-dev, liblz4-dev, libpq-dev, libssl-dev and libzstd-dev"
  }
}
# Its make writes into the tree that it builds.
cp -a "$source/." "$work/citus/"
# Files of a checkout are of any age; make would take configure for outdated and ask for autoconf.
touch "$work/citus/configure" "$work/citus"/src/include/*.in
cd "$work/citus"
# Without libcurl nothing reports to Citus's makers; without LLVM no clang is needed.
step "configuring Citus $version" ./configure "PG_CONFIG=$pg_config" --without-libcurl
step "building Citus $version" make -j "$(nproc)" with_llvm=no all
cd - >/dev/null
programs=$("$pg_config" --bindir)
if [ -n "$target" ]; then
  # PostgreSQL finds its files by where its programs are.
  for folder in "$programs" "$("$pg_config" --pkglibdir)" "$("$pg_config" --sharedir)"; do
    mkdir -p "$work/new$folder"
    cp -rL "$folder/." "$work/new$folder/"
  done
  step "installing into $target" make -C "$work/citus" with_llvm=no install "DESTDIR=$work/new"
  chmod 755 "$work/new"
  mkdir -p "$(dirname "$target")"
  mv "$work/new" "$target" # only when it is complete
  programs=$(cd "$target" && pwd)$programs
else
  step "installing into the system's PostgreSQL" make -C "$work/citus" with_llvm=no install
fi
say "Citus $version for $("$pg_config" --version)"
echo "$programs"
