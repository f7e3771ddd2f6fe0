#!/usr/bin/env bash
# The checkers catch what they are for: each case is a small tree with one fault.
set -euo pipefail
work=$(mktemp -d); trap 'rm -rf "$work"' EXIT
cases=0

fresh_tree() { # a tree without faults
    rm -rf "$work/t"
    mkdir -p "$work/t"/{docs,host/{base,site,raster,import,app},firmware/shared}
    cp docs/dependencies.txt "$work/t/docs/"
    echo '#include "base/vec.h"' >"$work/t/host/base/pose.h"
    echo '' >"$work/t/host/base/vec.h"
    printf '#include "base/pose.h"\n#include <stdio.h>\n' >"$work/t/host/site/store.h"
    echo '#include "site/store.h"' >"$work/t/host/import/ply.c"
    echo '#include "import/ply.h"' >"$work/t/host/app/cmd_import.c"
    echo '' >"$work/t/host/import/ply.h"
    echo '' >"$work/t/firmware/shared/regmap.h"
}

expect_pass() {
    cases=$((cases + 1))
    scripts/check-deps "$work/t" >"$work/out" || { echo "FAILED: $1 is refused:"; cat "$work/out"; exit 1; }
}

expect_fail() { # $1 what, $2 what the message must hold
    cases=$((cases + 1))
    if scripts/check-deps "$work/t" >"$work/out" 2>&1; then echo "FAILED: $1 is let through"; exit 1; fi
    grep -qF -- "$2" "$work/out" || { echo "FAILED: $1: no '$2' in:"; cat "$work/out"; exit 1; }
    fresh_tree
}

fresh_tree
expect_pass "a tree that follows the table"
echo '#include "site/store.h"' >>"$work/t/host/base/pose.h"
expect_fail "an upward include" 'host/base/pose.h:2: host/base may not include host/site'
echo '  #  include "site/store.h" // why' >"$work/t/host/raster/splat.c"
expect_fail "a sideways include" 'host/raster/splat.c:1: host/raster may not include host/site'
echo '#include "firmware/shared/regmap.h"' >>"$work/t/host/base/vec.h"
expect_fail "base including firmware" 'host/base may not include firmware/shared'
echo '#include "base/vec.h"' >>"$work/t/firmware/shared/regmap.h"
expect_fail "firmware including the host" 'firmware/shared may not include host/base'
echo '#include "../site/store.h"' >>"$work/t/host/import/ply.c"
expect_fail "a path with .." 'a path with ..'
echo '#include <base/vec.h>' >>"$work/t/host/site/store.h"
expect_fail "our header in angle brackets" 'included with quotes'
echo '#include "base/nothing.h"' >>"$work/t/host/site/store.h"
expect_fail "a header that is not there" 'is no file of the tree'
mkdir "$work/t/host/misc"; echo '' >"$work/t/host/misc/stuff.c"
expect_fail "a folder without a row" 'no row in docs/dependencies.txt'
echo '' >"$work/t/host/site/vec.h"
expect_fail "a stem in two places" 'host/site/vec.h: another vec.h is host/base/vec.h'
rm "$work/t/docs/dependencies.txt"
expect_fail "a tree without the table" 'no docs/dependencies.txt'

# check-headers: a header that needs another one first, and one without a guard
printf 'static inline size_t needy(void) { return 0; }\n' >"$work/needy.h"
printf 'struct unguarded { int x; };\n' >"$work/unguarded.h"
printf '#ifndef G\n#define G\nstatic inline int *cast(void *p) { return p; }\n#endif\n' >"$work/c_only.h"
printf '#ifndef G\n#define G\n#include <stddef.h>\nsize_t fine(void);\n#endif\n' >"$work/fine.h"
for bad in needy unguarded c_only; do
    cases=$((cases + 1))
    if scripts/check-headers "$work/$bad.h" >"$work/out" 2>&1; then echo "FAILED: $bad.h is let through"; exit 1; fi
    grep -qF "$bad.h" "$work/out"
done
cases=$((cases + 1))
scripts/check-headers "$work/fine.h" >/dev/null || { echo "FAILED: fine.h is refused"; exit 1; }

# check-symbols: a library whose object exports a foreign name
printf 'int alpha_one(void); int alpha_one(void) { return 1; }\nint beta(void); int beta(void) { return 2; }\n' >"$work/alpha.c"
mkdir -p "$work/lib"
gcc -c "$work/alpha.c" -o "$work/alpha.c.o"
ar rcs "$work/lib/libsc_test.a" "$work/alpha.c.o"
cases=$((cases + 1))
if scripts/check-symbols "$work/lib" >"$work/out" 2>&1; then echo "FAILED: a foreign name is let through"; exit 1; fi
grep -qF 'alpha.c exports beta' "$work/out" || { echo "FAILED:"; cat "$work/out"; exit 1; }
if grep -qF 'alpha_one' "$work/out"; then echo "FAILED: alpha_one is refused"; exit 1; fi
cases=$((cases + 1))
if scripts/check-symbols "$work/nothing" >"$work/out" 2>&1; then echo "FAILED: no library at all passes"; exit 1; fi

echo "$cases cases: the checkers catch what they are for"
