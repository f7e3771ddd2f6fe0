#!/usr/bin/env bash
# scripts/bench: its list, its refusals, and that the rasteriser's figures are all there. No timing is asserted.
set -euo pipefail
export BENCH_BUILD=${SCANCART_BUILD:?} SCANCART_DATA=/nonexistent
fail() { printf 'bench.sh: %s\n' "$*" >&2; exit 1; }
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT

scripts/bench --list >"$dir/list"
grep -q '^raster ' "$dir/list" || fail "raster is not in the list"
rc=0; scripts/bench nonsense 2>"$dir/err" || rc=$?
[ $rc = 2 ] && grep -q 'no measurement nonsense' "$dir/err" || fail "a name that is not there gave $rc"
rc=0; scripts/bench --json 2>/dev/null || rc=$?
[ $rc = 2 ] || fail "--json without a file gave $rc"

scripts/bench raster --quick --json "$dir/out.json" >"$dir/table" 2>"$dir/err" || fail "$(cat "$dir/err")"
for name in points splat mesh; do
    jq -e --arg n ${name}_msamples_per_s '.[] | select(.name == $n) | .value > 0 and .unit == "Msamples/s"' \
        "$dir/out.json" >/dev/null || fail "no ${name}_msamples_per_s in $(cat "$dir/out.json")"
    grep -q "${name}_msamples_per_s" "$dir/table" || fail "no ${name}_msamples_per_s in the table"
done
for name in splat_to_mesh splat_to_points tiles_rejected_share rejection_time_share splat_bytes_per_sample; do
    jq -e --arg n $name 'any(.[]; .name == $n)' "$dir/out.json" >/dev/null || fail "no $name"
done
