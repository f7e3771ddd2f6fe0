# tests of import
scancart_test(test_dequantise SOURCES unit/test_dequantise.c DEPS sc_import LABELS "unit;threads")
