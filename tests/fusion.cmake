# tests of fusion
scancart_test(test_tile_code SOURCES unit/test_tile_code.c DEPS sc_base LABELS unit)
scancart_test(test_tile_pack SOURCES unit/test_tile_pack.c DEPS sc_base LABELS unit)
scancart_fuzz(tile_pack SOURCES fuzz/fuzz_tile_pack.c DEPS sc_base)
scancart_test(test_noise SOURCES unit/test_noise.c DEPS sc_fusion LABELS unit)
scancart_test(prop_rays SOURCES prop/prop_rays.c DEPS sc_fusion LABELS "prop")
scancart_script_test(e2e_fuse COMMAND bash tests/e2e/fuse.sh LABELS "e2e;slow" TIMEOUT 300)
