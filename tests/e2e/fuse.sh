#!/usr/bin/env bash
# From the twin's packets to photographs, tiles and a picture: what is up to date is not made again, threads do not matter, the
# surfaces lie where they are, and the site stays good.
set -euo pipefail
bin=${SCANCART_BIN:?}
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
fail() { printf 'fuse: %s\n' "$1" >&2; exit 1; }
small=(--quality preview --detail 0.3 --set pan.from_deg=-40 --set pan.to_deg=40 --set camera.width_px=96
       --set camera.height_px=144 --set camera.step_deg=40 --set camera.rays_per_pixel=1 --stands 1)

"$bin" twin scan room "$dir/a" "${small[@]}" >/dev/null
cp -r "$dir/a" "$dir/b"
OMP_NUM_THREADS=1 "$bin" fuse "$dir/a" --json >"$dir/first.json"
OMP_NUM_THREADS=3 "$bin" fuse "$dir/b" >/dev/null
photos() { (cd "$1/photos" && ls | sort); }
[ -n "$(photos "$dir/a")" ] || fail "no photographs"
[ "$(photos "$dir/a")" = "$(photos "$dir/b")" ] || fail "another number of threads gave other photographs"
[ "$(ls "$dir/a/tiles")" = "$(ls "$dir/b/tiles")" ] || fail "another number of threads gave other tiles"
"$bin" check "$dir/a" >/dev/null || fail "the site is not good"

# again: nothing is made anew
before=$(photos "$dir/a")
"$bin" fuse "$dir/a" >"$dir/again.txt"
grep -Eq '\(([1-9][0-9]*) up to date\)' "$dir/again.txt" || fail "did not say that photographs are up to date"
[ "$before" = "$(photos "$dir/a")" ] || fail "photographs changed without a reason"

# the room's surfaces are seen from its stand: most of the picture is covered, nothing is nearer than the furniture
photo=$("$bin" info "$dir/a" --json | python3 -c 'import json,sys; print(json.load(sys.stdin)["stations"][0]["photos"][0]["name"])')
"$bin" shot "$dir/a" --photo "$photo" -o "$dir/own.png" --json >"$dir/shot.json"
python3 - "$dir/shot.json" <<'PY' || fail "the photograph's own view is not covered"
import json, sys
assert json.load(open(sys.argv[1]))["coverage"] > 0.5
PY

# what cannot be done: one line
if "$bin" fuse "$dir/nowhere" >/dev/null 2>"$dir/err"; then fail "fused nothing"; fi
[ "$(wc -l <"$dir/err")" = 1 ] || fail "not one line"
echo "fuse: all claims hold"
