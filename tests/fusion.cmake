# tests of fusion
scancart_test(test_tile_code SOURCES unit/test_tile_code.c DEPS sc_base LABELS unit)
scancart_test(test_tile_pack SOURCES unit/test_tile_pack.c DEPS sc_base LABELS unit)
scancart_fuzz(tile_pack SOURCES fuzz/fuzz_tile_pack.c DEPS sc_base)
scancart_test(test_noise SOURCES unit/test_noise.c DEPS sc_fusion LABELS unit)
scancart_test(prop_rays SOURCES prop/prop_rays.c DEPS sc_fusion LABELS "prop")
scancart_script_test(e2e_fuse COMMAND bash tests/e2e/fuse.sh LABELS "e2e;slow" TIMEOUT 300)
scancart_test(test_layer SOURCES unit/test_layer.c DEPS sc_fusion LABELS unit)
scancart_test(prop_fusion SOURCES prop/prop_fusion.c support/analytic.c DEPS sc_fusion LABELS "prop")
scancart_test(prop_skins SOURCES prop/prop_skins.c support/analytic.c DEPS sc_fusion LABELS "prop")
# Threads that wait for work let others have the processor.
set_tests_properties(prop_rays prop_fusion prop_skins PROPERTIES ENVIRONMENT "OMP_WAIT_POLICY=passive")
add_executable(bench_fusion bench/bench_fusion.c bench/bench_fusion_speed.c
  bench/bench_fusion_accuracy.c bench/bench_fusion_skins.c bench/bench_fusion_cull.c
  bench/bench_fusion_code.c support/analytic.c
  "${CMAKE_SOURCE_DIR}/host/app/fuse_settings.c")
target_link_libraries(bench_fusion PRIVATE sc_twin sc_fusion sc_site OpenMP::OpenMP_C PkgConfig::PKG_libzstd)
