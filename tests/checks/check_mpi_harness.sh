#!/bin/sh
# Does the test harness see a failure, a hang and, under the sanitizers, a leak that only the last rank has?
# Needs MPM_MPIRUN, MPM_BIN_DIR and MPM_SANITIZED in the environment; ctest sets them.
set -u
log=$(mktemp)
trap 'rm -f "$log"' EXIT
wrong=0

# expect CODE TEXT TEST: the test ends with exit code CODE ("fails": any but 0) and prints TEXT.
expect() {
  # $MPM_MPIRUN is a command with its options.
  # shellcheck disable=SC2086
  $MPM_MPIRUN -n 3 "$MPM_BIN_DIR/test_harness_faults" --gtest_color=no --gtest_filter="HarnessFaults.$3" \
    >"$log" 2>&1
  code=$?
  if [ "$1" = fails ]; then [ "$code" -ne 0 ]; else [ "$code" -eq "$1" ]; fi
  code_ok=$?
  if [ "$code_ok" -eq 0 ] && grep -q -e "$2" "$log"; then
    echo "ok: $3 ended with exit code $code, expected $1, and printed '$2'"
  else
    echo "WRONG: $3 ended with exit code $code, expected $1 and the text '$2'; it printed:"
    cat "$log"
    wrong=1
  fi
}

export MPM_TEST_TIMEOUT=60
expect 0 '\[  PASSED  \] 1 test' Passes
expect 1 '^\[rank 2\] FAILED in HarnessFaults.FailsOnTheLastRank' FailsOnTheLastRank
expect 1 'FAILED  . HarnessFaults.FailsOnTheLastRank' FailsOnTheLastRank
expect 1 'failed on rank 2, see stderr' ThrowsOnTheLastRank
expect 1 'no test was selected' NoSuchTest
export MPM_TEST_TIMEOUT=4
expect 124 '^\[rank 2\] HANGS: HarnessFaults.LeavesTheOthersInABarrier failed here' LeavesTheOthersInABarrier
expect 124 '^\[rank 0\] HANGS: HarnessFaults.WaitsForAMessageThatNobodySends ' \
  WaitsForAMessageThatNobodySends
if [ "$MPM_SANITIZED" = ON ]; then
  export MPM_TEST_TIMEOUT=60
  expect fails 'LeakSanitizer: detected memory leaks' LeaksOnTheLastRank
  expect fails 'signed integer overflow' OverflowsOnTheLastRank
fi
exit $wrong
