# tests of base
scancart_test(test_sheet SOURCES unit/test_sheet.c DEPS sc_base LABELS unit)
