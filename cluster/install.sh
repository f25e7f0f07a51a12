#!/bin/sh
# Installs the Debian 12 packages that mpm_hpc needs; asks for root rights only if some are missing.
set -u

packages="build-essential cmake ninja-build pkg-config
  libopenmpi-dev openmpi-bin petsc-dev libpetsc-real-dev libhdf5-openmpi-dev libmetis-dev
  libeigen3-dev libtomlplusplus-dev libcli11-dev libfmt-dev nlohmann-json3-dev libmuparser-dev
  libgtest-dev libgmock-dev libbenchmark-dev libtrilinos-zoltan-dev
  python3-matplotlib python3-h5py python3-numpy python3-pil"

if ! command -v dpkg-query >/dev/null 2>&1; then
  echo "This is not a Debian system: provide what these packages hold by other means: $packages"
  exit 0 # the configuration names what it can't find
fi

missing=
for package in $packages; do
  case $(dpkg-query -W -f='${Status}' "$package" 2>/dev/null) in
    "install ok installed") ;;
    *) missing="$missing $package" ;;
  esac
done
if [ -z "$missing" ]; then
  echo "All Debian packages are there."
  exit 0
fi
echo "Missing Debian packages:$missing"

if [ "$(id -u)" -eq 0 ]; then
  as_root=""
elif command -v sudo >/dev/null 2>&1 && { [ -t 0 ] || sudo -n true 2>/dev/null; }; then
  as_root=sudo
else
  echo "Ask your administrator to run: apt-get install --no-install-recommends$missing"
  exit 1
fi

logs=$(dirname "$0")/../build/logs
mkdir -p "$logs" || exit 1
log=$(cd "$logs" && pwd)/install.log

apt() {
  $as_root env DEBIAN_FRONTEND=noninteractive apt-get -q -o DPkg::Lock::Timeout=300 "$@" >>"$log" 2>&1
}

install_missing() {
  apt update # one unreachable source does no harm
  # shellcheck disable=SC2086
  apt install -y --no-install-recommends $missing
}

echo "Installing them, some minutes (log: $log)"
: >"$log"
install_missing || {
  echo "The installation failed; trying once more in 10 seconds."
  sleep 10
  install_missing
} || {
  tail -n 20 "$log"
  echo "apt-get could not install:$missing; its whole output is in $log"
  exit 1
}
