#!/usr/bin/env bash
# The right photograph of the aloe pair, made from the left one and its disparities, against the real one.
set -euo pipefail
bin=${SCANCART_BIN:?}
aloe=${SCANCART_DATA:-../shared/data}/aloe
[ -e "$aloe/aloeGT.png" ] || { echo "SKIP: no aloe in the real data (\$SCANCART_DATA)"; exit 77; }
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
"$bin" new "$dir/site" >/dev/null
"$bin" import photo "$dir/site" --name left --image "$aloe/aloeL.jpg" --disparity "$aloe/aloeGT.png" \
    --disparity-step 1 --hfov-deg 40 >/dev/null
for primitive in splat mesh; do
    "$bin" shot "$dir/site" --offset 1,0,0 -p $primitive -o "$dir/right.png" --compare "$aloe/aloeR.jpg" --json >"$dir/out"
    # What was measured (docs/aloe.md), less a twentieth of a dB and of a percent for another machine's libm.
    python3 - "$dir/out" $primitive <<'PY'
import json, sys
v, name = json.load(open(sys.argv[1])), sys.argv[2]
least = {'splat': (29.95, 0.8350), 'mesh': (29.80, 0.8270)}[name]
print('%s: %.2f dB over %.2f %%' % (name, v['psnr_db'], 100 * v['coverage']))
sys.exit(v['psnr_db'] < least[0] or v['coverage'] < least[1])
PY
done
