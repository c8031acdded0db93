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
# $1 test, the rest a command, whose output is then $work/log
try() {
    name=$1
    shift
    if "$@" >"$work/log" 2>&1; then ok "$name"; else bad "$name"; fi
}
# $1 test program, $2 its output: adds what the closing line says has passed
count() {
    # shellcheck disable=SC2046
    set -- "$1" "$2" $(tr -d '\r' <"$2" | tail -1 |
        sed -n 's/^\([0-9]*\) passed, \([0-9]*\) failed, [0-9]* skipped$/\1 \2/p')
    if [ "${3:-0}" -gt 0 ] && [ "$4" = 0 ]; then passed=$((passed + $3)); else
        echo "FAIL $1: ${3:-0} passed, ${4:-0} failed"
        tail -20 "$2"
        failed=$((failed + 1))
    fi
}
finish() {
    echo "$passed passed, $failed failed, $skipped skipped"
    [ "$failed" = 0 ]
    exit
}
