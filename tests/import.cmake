# tests of import
scancart_test(test_dequantise SOURCES unit/test_dequantise.c DEPS sc_import LABELS "unit;threads")
scancart_test(test_photo_tiff SOURCES unit/test_photo_tiff.c DEPS sc_site LABELS unit)
scancart_test(test_photo_import SOURCES unit/test_photo_import.c DEPS sc_import LABELS unit)
scancart_test(test_scan_3dtk SOURCES unit/test_scan_3dtk.c DEPS sc_import LABELS unit)
scancart_test(test_ply_grid SOURCES unit/test_ply_grid.c DEPS sc_import LABELS unit)
scancart_test(test_sample_grid SOURCES unit/test_sample_grid.c DEPS sc_base LABELS unit)
