#!/bin/sh
# From a fresh Debian 12 to a first result, as any user unless packages are missing:
#   sh cluster/quickstart.sh demo    installs, builds, runs the branching plate on two ranks and draws it
#   sh cluster/quickstart.sh test    installs, builds and runs the tests
set -u

case ${1-} in
  demo | test) ;;
  *)
    echo "usage: sh $0 demo|test" >&2
    exit 2
    ;;
esac
task=$1
cd "$(dirname "$0")/.." || exit 1
root=$(pwd)
programs=$root/build/release/bin
logs=$root/build/logs
mkdir -p "$logs" || exit 1

# run NAME SENTENCE COMMAND...: shows the command's output and keeps it in a log; ends the script if it fails.
run() {
  begin "$1" "$2"
  shift 2
  { "$@" 2>&1 </dev/null; echo $? >"$log.code"; } | tee "$log"
  code=$(cat "$log.code")
  rm -f "$log.code"
  [ "$code" -eq 0 ] || fail
}

# The same with nothing shown while all goes well.
run_quietly() {
  begin "$1" "$2"
  shift 2
  "$@" >"$log" 2>&1 </dev/null && return
  code=$?
  tail -n 30 "$log"
  fail
}

begin() {
  name=$1
  log=$logs/$name.log
  echo "== $2"
}

fail() {
  echo "FAILED: $name ended with exit code $code; its whole output is in $log"
  exit 1
}

# One compiler takes up to about 2 GB.
count_jobs() {
  cores=$(nproc 2>/dev/null || echo 1)
  megabytes=$(awk '/^MemAvailable:/ {print int($2 / 1024)}' /proc/meminfo 2>/dev/null)
  limit=$(cat /sys/fs/cgroup/memory.max 2>/dev/null)
  case $limit in
    '' | max) ;;
    *)
      limit=$(awk -v bytes="$limit" 'BEGIN {print int(bytes / 1048576)}')
      [ "$limit" -lt "${megabytes:-$limit}" ] && megabytes=$limit
      ;;
  esac
  jobs=$((${megabytes:-2048} / 2048))
  [ "$jobs" -gt "$cores" ] && jobs=$cores
  [ "$jobs" -lt 1 ] && jobs=1
  echo "$jobs"
}

if [ "$(id -u)" -eq 0 ]; then
  export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
fi
# Containers often forbid one process to read another's memory.
export OMPI_MCA_btl_vader_single_copy_mechanism=none

begin install "Looking for the Debian packages"
sh cluster/install.sh || {
  code=$?
  echo "FAILED: the packages could not be installed (exit code $code)"
  exit 1
}
run_quietly configure "Configuring build/release" cmake --preset release
jobs=$(count_jobs)
case $task in
  demo) targets="--target mpm_hpc mpm_view" ;;
  test) targets= ;;
esac
# shellcheck disable=SC2086  # a list of words
run_quietly build "Building with $jobs jobs, some minutes (log: $logs/build.log)" \
  cmake --build --preset release -j "$jobs" $targets

case $task in
  demo)
    output=$root/branching_plate_2d_out
    run demo "Running the branching plate on 2 ranks" \
      mpirun --oversubscribe --bind-to none -n 2 \
      "$programs/mpm_hpc" apps/scenes/branching_plate_2d.toml --output "$output" --force
    run view "Drawing the frames" "$programs/mpm_view" "$output"
    pictures=$(find "$output" -name '*.png' | sort)
    if [ -z "$pictures" ]; then
      echo "FAILED: mpm_view drew no picture; its output is in $log"
      exit 1
    fi
    echo "== Done. Results: $output; pictures:"
    echo "$pictures"
    ;;
  test)
    run test "Running the tests" \
      ctest --test-dir build/release -LE slow -j 2 --output-on-failure --no-tests=error
    echo "== Done (log: $log)"
    grep 'tests passed' "$log"
    ;;
esac
