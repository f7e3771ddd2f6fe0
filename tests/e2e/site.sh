#!/usr/bin/env bash
# new, info, check as a user types them: output, exit status, one line on failure, nothing half made.
set -euo pipefail
bin=${SCANCART_BIN:?}
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"

fail() { printf 'site.sh: %s\n' "$*" >&2; exit 1; }

# expect STATUS COMMAND...: runs it, keeps its output in out and err
expect() {
    local want=$1 got=0
    shift
    "$@" >out 2>err || got=$?
    [ "$got" = "$want" ] || fail "$* gave $got, not $want: $(cat out err)"
    if [ "$want" = 1 ]; then
        [ "$(wc -l <err)" = 1 ] || fail "$* should fail with one line: $(cat err)"
    fi
}
field() { python3 -c 'import json, sys; v = json.load(open("out"))
for k in sys.argv[1].split("."): v = v[int(k)] if k.isdigit() else v[k]
print(v)' "$1"; }

for command in new info check; do
    expect 0 "$bin" "$command" --help
    grep -q "Example: scancart $command" out || fail "$command --help has no example"
    expect 2 "$bin" "$command"
    expect 2 "$bin" "$command" a b
    expect 2 "$bin" "$command" a --nonsense
done

expect 0 "$bin" new site --name 'A7 km 112' --epsg 25832 --offset 565000.25,5930000.5,12
expect 0 "$bin" info site --json
[ "$(field name)" = 'A7 km 112' ] || fail "the name is lost"
[ "$(field georef.epsg) $(field georef.offset_m.1)" = '25832 5930000.5' ] || fail "the georeference is lost"
[ "$(field custody.last)" = sealed ] || fail "not sealed"
expect 0 "$bin" info site
grep -q 'EPSG:25832' out || fail "info does not tell the georeference"
expect 0 "$bin" check site
expect 0 "$bin" check site --json
[ "$(field good) $(field errors)" = 'True 0' ] || fail "a new site is not good"

expect 1 "$bin" new site
grep -q 'is a site already' err || fail "new over a site: $(cat err)"
expect 2 "$bin" new other --offset 1,2
expect 2 "$bin" new other --name ''
expect 1 "$bin" new other --offset 1,2,3
grep -q 'EPSG' err || fail "offset without a code: $(cat err)"
expect 1 "$bin" new no/such/parent
[ ! -e other ] && [ ! -e no ] || fail "a failed new left something"
for command in info check; do
    expect 1 "$bin" "$command" nothing
    expect 1 "$bin" "$command" /dev/null
done

# a busy site names who writes
cp -r site busy
exec 9<>busy/writer.lock
flock -n 9
echo "process 123 on test" >busy/writer.lock
expect 0 "$bin" info busy
expect 0 "$bin" check busy
exec 9>&-

# damage: one byte of a row, of the header; a file in the way
sum=$(sha256sum <site/site.db)
damage() { cp -r site "$1"; printf '%b' "$3" | dd of="$1/site.db" bs=1 seek="$2" conv=notrunc status=none; }
at=$(grep -obaU 'A7 km 112' site/site.db | head -n 1 | cut -d: -f1)
damage damaged "$at" 'B'
expect 1 "$bin" check damaged
grep -q 'site.db' err || fail "check does not name the file: $(cat err)"
grep -q 'table site, row 1' out || fail "check does not name the row: $(cat out)"
"$bin" check damaged --json >out 2>err && fail "check --json of a damaged site succeeded"
[ "$(field good)" = False ] || fail "check --json calls it good"
expect 1 "$bin" info damaged
damage header 0 'X'
expect 1 "$bin" check header
expect 1 "$bin" info header
cp -r site cut && truncate -s 20000 cut/site.db
expect 1 "$bin" check cut
cp -r site none && : >none/site.db
expect 1 "$bin" check none
cp -r site newer && python3 - <<'PY'
import sqlite3
db = sqlite3.connect('newer/site.db')
db.execute('PRAGMA user_version = 99')
db.commit()
PY
expect 1 "$bin" info newer
grep -q 'newer scancart' err || fail "a newer site: $(cat err)"
echo note >site/photos/note.txt
expect 0 "$bin" check site
grep -q '^warning: photos/note.txt' out || fail "a foreign file is not told"
[ "$sum" = "$(sha256sum <site/site.db)" ] || fail "info or check changed site.db"
[ "$(ls site)" = "$(printf 'frames\nphotos\nsite.db\ntiles\nwriter.lock')" ] || fail "left: $(ls site)"
echo "site.sh: good"
