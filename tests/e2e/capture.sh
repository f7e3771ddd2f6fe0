#!/usr/bin/env bash
# `scancart capture` as a crew uses it, with the simulated cart: a scan, one that is cut short and gone on with, what
# cannot be done, Ctrl-C, the service's file.
set -euo pipefail
bin=${SCANCART_BIN:?}
if [ -w /dev/shm ]; then export TMPDIR=/dev/shm; fi # a thousand flushes that nobody needs
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
fail() { echo "FAIL: $*" >&2; exit 1; }
export OMP_NUM_THREADS=1

mkdir "$dir/board" "$dir/slow"
printf 'name: twin\ntwin:\n  scene: room\n' >"$dir/board/board.yaml"
printf 'name: twin\ntwin:\n  scene: room\n  real_time: true\n' >"$dir/slow/board.yaml"
small=(--set head.samples_hz=2500 --set camera.width_px=96 --set camera.height_px=144 --set camera.rays_per_pixel=1)
quick=(--quality preview --from -176 --to -168 --photo-step 360)
# run EXPECTED_STATUS WORDS ARGUMENTS...: the exit status, and the words in what is said
run() {
    local want=$1 words=$2 rc=0
    shift 2
    timeout 200 "$bin" "$@" >"$dir/out" 2>"$dir/err" || rc=$?
    [ "$rc" = "$want" ] || fail "'$*' gave $rc, not $want: $(cat "$dir/out" "$dir/err")"
    grep -q -- "$words" "$dir/out" "$dir/err" || fail "'$*' does not say '$words': $(cat "$dir/out" "$dir/err")"
}

echo '== the accident, as by default (few degrees)'
run 0 complete capture "$dir/a" --board boards/twin --quality preview --from -1 --to 1 --photo-step 360 \
    --set camera.width_px=96 --set camera.height_px=144 --set camera.rays_per_pixel=1
run 0 'is good' check "$dir/a"
run 0 'samples' fuse "$dir/a"

echo '== a plan alone'
run 0 'at most' capture "$dir/p" --board "$dir/board" "${quick[@]}" --plan
[ ! -e "$dir/p" ] || fail 'a plan alone made a site'

echo '== twice the same: the same raw bytes'
run 0 complete capture "$dir/s" --board "$dir/board" "${small[@]}" "${quick[@]}"
run 0 complete capture "$dir/t" --board "$dir/board" "${small[@]}" "${quick[@]}"
chains() { sqlite3 "$1/site.db" "SELECT hex(chain) FROM chunk ORDER BY id"; }
[ "$(chains "$dir/s")" = "$(chains "$dir/t")" ] || fail 'two runs of the same cart differ'

echo '== cut short, gone on with; the first part is the beginning of an undisturbed run'
run 1 'power went' capture "$dir/c" --board "$dir/board" "${small[@]}" "${quick[@]}" --fault power_loss@16
head -c "$(sqlite3 "$dir/c/site.db" "SELECT sum(size_bytes) FROM chunk WHERE stream_id=1")" \
    <(sqlite3 "$dir/s/site.db" "SELECT hex(payload) FROM chunk WHERE stream_id=1" | tr -d '\n' | xxd -r -p) >"$dir/want"
sqlite3 "$dir/c/site.db" "SELECT hex(payload) FROM chunk WHERE stream_id=1" | tr -d '\n' | xxd -r -p >"$dir/got"
cmp "$dir/want" "$dir/got" || fail 'what was stored before the power went is not the beginning of the same scan'
[ -s "$dir/got" ] || fail 'nothing was stored before the power went'
run 1 'go on with --resume' capture "$dir/c" --board "$dir/board" --station middle
run 0 complete capture "$dir/c" --board "$dir/board" "${small[@]}" --resume
run 0 complete capture "$dir/c" --board "$dir/board" --resume
run 0 'is good' check "$dir/c"

echo '== what cannot be'
run 2 '--board' capture "$dir/x"
run 1 'No such' capture "$dir/x" --board "$dir/nowhere"
printf 'name: twin\ntwin:\n  scene: nowhere\n' >"$dir/bad.yaml"
run 1 'nowhere' capture "$dir/x" --board "$dir/bad.yaml"
printf 'name: x\ncontroler: 3\n' >"$dir/bad.yaml"
run 1 'bad.yaml:2' capture "$dir/x" --board "$dir/bad.yaml"
printf 'name: x\ncontroller:\n  device: /dev/nothing\nhead:\n  usb_vendor: 1\n  usb_product: 1\n' >"$dir/bad.yaml"
run 1 '/dev/nothing' capture "$dir/x" --board "$dir/bad.yaml"
[ ! -e "$dir/x" ] || fail 'a cart that is not there left a site behind'
run 1 'preview, field, survey' capture "$dir/x" --board "$dir/board" --quality best
run 1 'begins' capture "$dir/x" --board "$dir/board" --from 10 --to 5
run 1 'not a site' capture "$dir/nosite" --board "$dir/board" --resume
flock "$dir/s/writer.lock" sleep 3 &
holder=$!
sleep 0.3
run 1 'writ' capture "$dir/s" --board "$dir/board" --station other
wait $holder

echo '== Ctrl-C in real time: stopped in order, exit status 1, a good site'
"$bin" capture "$dir/r" --board "$dir/slow" "${small[@]}" "${quick[@]}" --no-photos >"$dir/out" 2>"$dir/err" &
scan=$!
sleep 4
kill -INT $scan
rc=0
wait $scan || rc=$?
[ $rc = 1 ] || fail "Ctrl-C gave $rc: $(cat "$dir/err")"
grep -q 'stopped on request' "$dir/err" || fail "Ctrl-C says: $(cat "$dir/err")"
grep -q 'laser and motors off' "$dir/out" || fail "Ctrl-C leaves: $(cat "$dir/out")"
run 0 'is good' check "$dir/r"

echo '== the service: its watchdog is fed, its file is right'
python3 - "$bin" "$dir" <<'PY'
import os, socket, subprocess, sys
binary, folder = sys.argv[1:]
path = os.path.join(folder, "notify")
s = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
s.bind(path)
s.settimeout(0.2)
run = subprocess.Popen([binary, "capture", folder + "/n", "--board", folder + "/board", "--set",
                        "head.samples_hz=2500", "--no-photos", "--quality", "preview", "--from", "-176", "--to",
                        "-174", "--station", "middle", "--keep-going"], env={**os.environ, "NOTIFY_SOCKET": path},
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
got, rounds = [], 0
while rounds < 1000:
    try:
        got.append(s.recv(4096).decode())
    except TimeoutError:
        rounds += 1
        if run.poll() is not None:
            break
assert run.wait() == 0
assert any("READY=1" in g for g in got) and any("WATCHDOG=1" in g for g in got) and "STOPPING=1" in got[-1], got
PY
if command -v systemd-analyze >/dev/null; then
    sed "s|/usr/bin/scancart|$(realpath "$bin")|" boards/rpi5/scancart-capture.service >"$dir/scancart-capture.service"
    systemd-analyze verify --man=no "$dir/scancart-capture.service" 2>"$dir/err" || fail "$(cat "$dir/err")"
    if grep -q 'scancart-capture.service' "$dir/err"; then fail "$(cat "$dir/err")"; fi
else
    echo 'SKIP: no systemd-analyze to verify the service with'
fi
echo 'capture: all as it should be'
