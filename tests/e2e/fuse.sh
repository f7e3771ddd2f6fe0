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

# stage by stage: seconds, memory, counts
python3 - "$dir/first.json" <<'PY' || fail "the report lacks something"
import json, sys
r = json.load(open(sys.argv[1]))
assert r["seconds"] > 0 and all(r["peak_bytes"][k] > 1e6 for k in ("photographs", "skins", "tiles"))
assert r["stations"][0]["samples"] > 1000 and r["stations"][0]["photographs"] == len(r["photographs"])
assert all(p["valid"] + p["no_return"] + p["dropped"] + p["unseen"] + p["sky"] == p["width_px"] * p["height_px"]
           for p in r["photographs"])
assert r["tiles"]["sampled"] + r["tiles"]["planes"] > 0 and r["tiles"]["bytes"] > r["tiles"]["bytes_level0"]
PY

# only what is out of date: another error makes new tiles of the old photographs
"$bin" fuse "$dir/a" --error-mm 8 --json >"$dir/coarser.json"
python3 - "$dir/coarser.json" <<'PY' || fail "made again what was up to date, or kept what was not"
import json, sys
r = json.load(open(sys.argv[1]))
assert all(p["up_to_date"] for p in r["photographs"]) and not r["tiles"]["up_to_date"]
PY

# the file of tiles is what its page says it is
python3 "$(dirname "$0")/tile_pack_reader.py" "$(ls -t "$dir"/a/tiles/* | head -n 1)" >"$dir/pack.json" || fail "the tiles"
python3 - "$dir/pack.json" "$dir/coarser.json" <<'PY' || fail "the tiles hold something else than was reported"
import json, sys
pack, tiles = json.load(open(sys.argv[1])), json.load(open(sys.argv[2]))["tiles"]
assert sum(p["samples"] for p in pack["photos"]) == tiles["samples"]
assert sum(p["planes"] for p in pack["photos"]) == tiles["planes"]
assert sum(p["coded"] for p in pack["photos"]) == tiles["bytes_level0"]
assert pack["error_m"] == 0.008
PY

# what cannot be done: one line
if "$bin" fuse "$dir/nowhere" >/dev/null 2>"$dir/err"; then fail "fused nothing"; fi
[ "$(wc -l <"$dir/err")" = 1 ] || fail "not one line"
echo "fuse: all claims hold"
