# tests of site
scancart_test(test_site SOURCES unit/test_site.c support/site_sample.c DEPS sc_site sqlite3 LABELS unit)
