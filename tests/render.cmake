# tests of render; the label gl: they draw with OpenGL ES where there is one, else they say SKIP
scancart_test(prop_render_agree SOURCES prop/prop_render_agree.c support/render_scenes.c support/room.c
  DEPS sc_render sc_raster sc_base LABELS "prop;gl" TIMEOUT 240)
scancart_test(prop_render_overlap SOURCES prop/prop_render_overlap.c support/room.c
  DEPS sc_render sc_raster sc_base LABELS "prop;gl")
scancart_test(test_view_measure SOURCES unit/test_view_measure.c support/room.c
  DEPS sc_render sc_raster sc_base LABELS "unit;gl")
scancart_script_test(view_window COMMAND tests/e2e/view_window.py LABELS "e2e" TIMEOUT 240)
add_executable(bench_viewer bench/bench_viewer.c)
target_link_libraries(bench_viewer PRIVATE sc_render sc_raster sc_twin sc_base)
add_executable(bench_viewer_site bench/bench_viewer_site.c)
target_link_libraries(bench_viewer_site PRIVATE sc_site sc_base)
add_executable(view_measure_twin support/view_measure_twin.c)
target_link_libraries(view_measure_twin PRIVATE sc_render sc_raster sc_twin sc_base)
scancart_script_test(e2e_view_measure COMMAND tests/e2e/view_measure.sh LABELS "e2e;slow" TIMEOUT 600)
scancart_test(test_tile_cache SOURCES unit/test_tile_cache.c support/view_fake.c
  DEPS sc_render sc_raster sc_base LABELS unit)
scancart_test(test_view_scene SOURCES unit/test_view_scene.c support/view_fake.c
  DEPS sc_render sc_raster sc_base LABELS unit)
scancart_test(prop_render_extremes SOURCES prop/prop_render_extremes.c support/render_scenes.c support/room.c
  DEPS sc_render sc_raster sc_base LABELS "prop;gl" TIMEOUT 240)
