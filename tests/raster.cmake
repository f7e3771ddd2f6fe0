# tests of raster
scancart_test(test_raster SOURCES unit/test_raster.c DEPS sc_raster LABELS unit)
scancart_test(test_metrics SOURCES unit/test_metrics.c DEPS sc_raster LABELS unit)
scancart_test(test_skin SOURCES unit/test_skin.c DEPS sc_raster LABELS unit)
scancart_test(test_downsample SOURCES unit/test_downsample.c DEPS sc_raster LABELS unit)
scancart_test(golden_raster SOURCES golden/test_raster_golden.c support/room.c DEPS sc_raster LABELS golden)
scancart_test(prop_raster SOURCES prop/prop_raster.c support/room.c DEPS sc_raster LABELS prop)
add_executable(bench_raster bench/bench_raster.c support/room.c)
target_link_libraries(bench_raster PRIVATE sc_raster OpenMP::OpenMP_C)
