# Counting of the test scripts, which source it: `. tests/counts.sh`. Texts in $work/log are shown
# with what failed.
passed=0 failed=0 skipped=0

ok() { passed=$((passed + 1)); }
bad() {
    echo "FAIL $1"
    [ ! -f "${work:-}/log" ] || tail -20 "$work/log"
    failed=$((failed + 1))
}
# $1 test, $2 why: `optional: ...` where CI may do without
skip() {
    echo "SKIP $1: $2"
    skipped=$((skipped + 1))
}
finish() {
    echo "$passed passed, $failed failed, $skipped skipped"
    [ "$failed" = 0 ]
    exit
}
