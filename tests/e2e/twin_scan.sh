#!/usr/bin/env bash
# The twin as a newcomer uses it: a scan into a site, the truth beside it, the same bytes from the same seed with any number
# of threads, and one clear line for what cannot be done.
set -euo pipefail
bin=${SCANCART_BIN:?}
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
small=(--set pan.from_deg=0 --set pan.to_deg=2 --set head.samples_hz=4000 --set camera.width_px=48
       --set camera.height_px=72 --set camera.step_deg=180 --set camera.rays_per_pixel=2 --stands 1)
fail() { printf 'twin_scan: %s\n' "$1" >&2; exit 1; }

# two runs, one and three threads: streams and frames are the same bytes
OMP_NUM_THREADS=1 "$bin" twin scan room "$dir/a" "${small[@]}" --truth "$dir/truth" --truth-samples --pictures "$dir/pictures" >/dev/null
OMP_NUM_THREADS=3 "$bin" twin scan room "$dir/b" "${small[@]}" >/dev/null
OMP_NUM_THREADS=2 "$bin" twin scan room "$dir/c" "${small[@]}" --seed 2 >/dev/null
dump() { python3 - "$1" <<'PY'
import hashlib, os, sqlite3, sys
db = sqlite3.connect(os.path.join(sys.argv[1], "site.db"))
names = [r[0] for r in db.execute("select name from sqlite_master where type='table' and name like '%chunk%'")]
h = hashlib.sha256()
for name in names:
    columns = [c[1] for c in db.execute(f"pragma table_info({name})")]
    blob = [c for c in columns if c in ("payload", "bytes", "data")]
    for row in db.execute(f"select {blob[0]} from {name} order by rowid"):
        h.update(row[0])
print(h.hexdigest(), *sorted(os.listdir(os.path.join(sys.argv[1], "frames"))))
PY
}
a=$(dump "$dir/a"); b=$(dump "$dir/b"); c=$(dump "$dir/c")
[ "$a" = "$b" ] || fail "another number of threads gave other bytes"
[ "$a" != "$c" ] || fail "another seed gave the same bytes"

# the site is whole, the truth is outside it, the pictures are there
"$bin" check "$dir/a" >/dev/null || fail "the site is not good"
[ -s "$dir/truth/truth.json" ] && [ -s "$dir/truth/twin.yaml" ] || fail "no truth"
[ -z "$(find "$dir/a" -name '*truth*')" ] || fail "truth inside the site"
for what in range intensity mixed camera; do [ -s "$dir/pictures/middle-$what.png" ] || fail "no $what picture"; done

# with the true rig the samples are where their echoes came from, with the nominal one they are not
"$bin" twin truth --site "$dir/a" --truth "$dir/truth" --json >"$dir/compare.json"
python3 - "$dir/compare.json" <<'PY' || fail "samples are not where they should be"
import json, sys
true, nominal = json.load(open(sys.argv[1]))
assert true["compared"] > 1000 and true["median_m"] < 0.004 < 0.02 < nominal["median_m"], (true, nominal)
PY

# what cannot be done is refused with one line
refuse() { # $1 what is said, the rest: arguments
    local says=$1; shift
    if "$bin" twin "$@" >"$dir/out" 2>"$dir/err"; then fail "accepted: $*"; fi
    [ "$(wc -l <"$dir/err")" = 1 ] || fail "not one line: $*"
    grep -q -- "$says" "$dir/err" || fail "does not say '$says': $(cat "$dir/err")"
}
printf 'v 0 0 0\n' >"$dir/empty.obj"
printf 'v 0 nan 0\n' >"$dir/nan.obj"
printf 'rig:\n  mirror_angle_deg: {true: 0.78}\n' >"$dir/units.yaml"
refuse 'no triangles' scan "$dir/empty.obj" "$dir/d"
refuse 'finite' scan "$dir/nan.obj" "$dir/d"
refuse 'mirror_angle_deg' scan room "$dir/d" --config "$dir/units.yaml"
refuse 'from a surface' scan room "$dir/d" --at 2.95,0,0
refuse 'no scene' scan nowhere "$dir/d"
refuse 'no fault' scan room "$dir/d2" --fault nothing@1
refuse 'lost power' scan room "$dir/e" "${small[@]}" --fault power_loss@15
"$bin" check "$dir/e" >/dev/null || fail "a power loss left a bad site"
refuse 'full' scan room "$dir/f" "${small[@]}" --fault disk_full@11+1000
"$bin" check "$dir/f" >/dev/null || fail "a full disk left a bad site"
printf 'twin_scan: good\n'
