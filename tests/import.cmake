# tests of import
scancart_test(test_dequantise SOURCES unit/test_dequantise.c DEPS sc_import LABELS "unit;threads")
scancart_test(test_photo_tiff SOURCES unit/test_photo_tiff.c DEPS sc_site LABELS unit)
