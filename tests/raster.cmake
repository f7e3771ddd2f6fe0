# tests of raster
scancart_test(test_raster SOURCES unit/test_raster.c DEPS sc_raster LABELS unit)
scancart_test(test_metrics SOURCES unit/test_metrics.c DEPS sc_raster LABELS unit)
scancart_test(test_skin SOURCES unit/test_skin.c DEPS sc_raster LABELS unit)
scancart_test(test_downsample SOURCES unit/test_downsample.c DEPS sc_raster LABELS unit)
scancart_test(golden_raster SOURCES golden/test_raster_golden.c support/room.c DEPS sc_raster LABELS golden)
# Not labelled "threads": the thread sanitizer does not see the barriers of GCC's OpenMP.
scancart_test(prop_raster SOURCES prop/prop_raster.c support/room.c DEPS sc_raster LABELS prop)
add_executable(bench_raster bench/bench_raster.c support/room.c)
target_link_libraries(bench_raster PRIVATE sc_raster OpenMP::OpenMP_C)
scancart_script_test(e2e_shot COMMAND tests/e2e/shot.sh LABELS e2e)
scancart_script_test(golden_aloe COMMAND tests/golden/aloe.sh LABELS golden)
scancart_script_test(e2e_bench COMMAND tests/e2e/bench.sh LABELS e2e)
