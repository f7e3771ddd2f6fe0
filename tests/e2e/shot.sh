#!/usr/bin/env bash
# shot as a user types it, on a small made-up photograph: views, figures, pictures, and what it refuses.
set -euo pipefail
bin=${SCANCART_BIN:?}
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"

fail() { printf 'shot.sh: %s\n' "$*" >&2; exit 1; }
# expect STATUS COMMAND...: runs it, keeps its output in out and err
expect() {
    local want=$1 got=0
    shift
    "$@" >out 2>err || got=$?
    [ "$got" = "$want" ] || fail "$* gave $got, not $want: $(cat out err)"
    if [ "$want" != 0 ] && [ "$(wc -l <err)" != 1 ]; then fail "$* should fail with one line: $(cat err)"; fi
}
# check EXPRESSION: python over the JSON in out, as v
check() { python3 -c 'import json, sys; v = json.load(open("out")); sys.exit(not eval(sys.argv[1]))' "$1" ||
    fail "not so: $1 in $(cat out)"; }

python3 - <<'PY'
import struct
w, h = 96, 64
with open('a.ppm', 'wb') as f:
    f.write(b'P6 %d %d 255\n' % (w, h))
    for v in range(h):
        for u in range(w):
            f.write(bytes(((u * 2) % 256, (v * 3) % 256, 128 + 100 * ((u // 8 + v // 8) % 2))))
with open('a.pgm', 'wb') as f:  # a wall at 4 m, a square at 2 m before it, a hole
    f.write(b'P5 %d %d 65535\n' % (w, h))
    for v in range(h):
        for u in range(w):
            z = 2000 if 30 <= u < 60 and 20 <= v < 45 else 4000
            f.write(struct.pack('>H', 0 if 70 <= u < 80 and 10 <= v < 20 else z))
PY
"$bin" new site >/dev/null
"$bin" import photo site --image a.ppm --depth a.pgm --fx 90 --fy 90 --cx 47.5 --cy 31.5 --name a --station s >/dev/null

expect 0 "$bin" shot --help
grep -q 'Example' out || fail 'no example in --help'

# A photograph's own view is the photograph, but for what it does not know.
for primitive in points splat mesh; do
    expect 0 "$bin" shot site -o own.png -p $primitive --compare a.ppm --json --supersample 1 --keep-mixed
    check 'v["psnr_db"] is None or v["psnr_db"] > 60'
    check '0.9 < v["coverage"] <= 0.99'
    check 'v["width_px"] == 96 and v["height_px"] == 64 and v["photographs"] == 1'
done

# From the side something is hidden; all unknown volumes are more than none.
expect 0 "$bin" shot site -o side.png --offset 0.5,0,0 --json
check 'v["coverage"] < 0.95'
expect 0 "$bin" shot site -o side.png --offset 0.5,0,0 --skins leave-out --json
check 'v["unknown"] == 0'
expect 0 "$bin" shot site -o side.png --offset 0.5,0,0 -p mesh --skins colour --json
check 'v["unknown"] > 0.01'
expect 0 "$bin" shot site -o only.png --offset 0.5,0,0 --skins only --json
check 'v["coverage"] == 0 and v["unknown"] > 0.01'

# Views: size, from an eye, parallel; depth pictures hold millimetres.
expect 0 "$bin" shot site -o small.png --size 48 --json
check 'v["width_px"] == 48 and v["height_px"] == 32'
expect 0 "$bin" shot site -o eye.png --eye 0,-1,0.2 --target 0,4,0 --fov 50 --size 80x60 --json
check 'v["coverage"] > 0.5'
expect 0 "$bin" shot site -o plan.png --parallel 3 -p mesh --size 60x40 --json
check 'v["coverage"] > 0.5'
expect 0 "$bin" shot site -o own.png --depth depth.png --depth16 depth16.png --supersample 1
python3 - <<'PY' || fail 'depth16.png does not hold millimetres'
import struct, zlib
data = open('depth16.png', 'rb').read()
assert data[24] == 16 and data[25] == 0  # 16 bits, grey
at, raw = 8, b''
while at < len(data):
    n, kind = struct.unpack('>I4s', data[at:at + 8])
    raw += data[at + 8:at + 8 + n] if kind == b'IDAT' else b''
    at += 12 + n
raw = zlib.decompress(raw)
width = 96
rows, before = [], bytes(2 * width)
for v in range(64):
    line = raw[v * (2 * width + 1):(v + 1) * (2 * width + 1)]
    kind, out = line[0], bytearray(line[1:])
    for i in range(len(out)):
        a = out[i - 2] if i >= 2 else 0
        b, c = before[i], before[i - 2] if i >= 2 else 0
        p = a + b - c
        paeth = a if abs(p - a) <= abs(p - b) and abs(p - a) <= abs(p - c) else b if abs(p - b) <= abs(p - c) else c
        out[i] = (out[i] + (0, a, b, (a + b) // 2, paeth)[kind]) % 256
    rows.append(struct.unpack('>%dH' % width, out))
    before = bytes(out)
assert abs(rows[5][5] - 4000) <= 1 and abs(rows[30][40] - 2000) <= 1 and rows[14][75] == 0, (rows[5][5], rows[30][40])
PY

# Refusals: one line, exit 1 for what is not there, 2 for what makes no sense.
expect 2 "$bin" shot site
expect 2 "$bin" shot -o x.png
expect 2 "$bin" shot site -o x.png -p cubes
expect 2 "$bin" shot site -o x.png --supersample 0
expect 2 "$bin" shot site -o x.png --background 1,2
expect 1 "$bin" shot nowhere -o x.png
expect 1 "$bin" shot site -o x.png --photo b
expect 1 "$bin" shot site -o x.png --photos b
expect 1 "$bin" shot site -o x.png --except a
expect 1 "$bin" shot site -o x.png --size 0x5
expect 1 "$bin" shot site -o x.png --eye 0,0,0
expect 1 "$bin" shot site -o x.png --eye 0,0,0 --target 0,0,0
expect 1 "$bin" shot site -o x.png --offset 1,2
expect 1 "$bin" shot site -o x.png --size 10x10 --compare a.ppm
expect 1 "$bin" shot site -o nowhere/x.png
expect 1 "$bin" shot site -o x.png --radius 0
[ ! -e x.png ] || fail 'a refused shot left a picture'
