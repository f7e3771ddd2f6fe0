# tests of import
# not labelled threads: the thread sanitizer does not know the barriers of GCC's OpenMP
scancart_test(test_dequantise SOURCES unit/test_dequantise.c DEPS sc_import LABELS unit)
scancart_test(test_photo_tiff SOURCES unit/test_photo_tiff.c DEPS sc_site LABELS unit)
scancart_test(test_photo_import SOURCES unit/test_photo_import.c DEPS sc_import LABELS unit)
scancart_test(test_scan_3dtk SOURCES unit/test_scan_3dtk.c DEPS sc_import LABELS unit)
scancart_test(test_scan_fan SOURCES unit/test_scan_fan.c DEPS sc_import LABELS unit)
scancart_test(test_scan_spin SOURCES unit/test_scan_spin.c DEPS sc_import LABELS unit)
scancart_test(test_kitti_calib SOURCES unit/test_kitti_calib.c DEPS sc_import LABELS unit)
scancart_test(test_ply_grid SOURCES unit/test_ply_grid.c DEPS sc_import LABELS unit)
scancart_test(test_sample_grid SOURCES unit/test_sample_grid.c DEPS sc_base LABELS unit)
scancart_test(test_import_real SOURCES golden/test_import_real.c DEPS sc_import LABELS golden TIMEOUT 120)
# the system's Python: the one that has Debian's OpenCV
scancart_script_test(e2e_import COMMAND /usr/bin/python3 "${CMAKE_SOURCE_DIR}/tests/e2e/import_commands.py"
  LABELS e2e)
scancart_script_test(e2e_photo_tiff_readers
  COMMAND /usr/bin/python3 "${CMAKE_SOURCE_DIR}/tests/e2e/photo_tiff_readers.py" LABELS e2e)
scancart_fuzz(photo_tiff SOURCES fuzz/fuzz_photo_tiff.c DEPS sc_site)
scancart_fuzz(scan_3dtk SOURCES fuzz/fuzz_scan_3dtk.c DEPS sc_import)
scancart_fuzz(scan_pose SOURCES fuzz/fuzz_scan_pose.c DEPS sc_import)
scancart_fuzz(scan_fan SOURCES fuzz/fuzz_scan_fan.c DEPS sc_import)
scancart_fuzz(scan_spin SOURCES fuzz/fuzz_scan_spin.c DEPS sc_import)
scancart_fuzz(kitti_calib SOURCES fuzz/fuzz_kitti_calib.c DEPS sc_import)
scancart_fuzz(ply_grid SOURCES fuzz/fuzz_ply_grid.c DEPS sc_import)
scancart_fuzz(ply_conf SOURCES fuzz/fuzz_ply_conf.c DEPS sc_import)
