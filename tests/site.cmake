# tests of site
scancart_test(test_site SOURCES unit/test_site.c support/site_sample.c DEPS sc_site sqlite3 LABELS unit)
scancart_test(prop_site_damage SOURCES prop/prop_site_damage.c support/site_sample.c DEPS sc_site sqlite3
  LABELS prop TIMEOUT 300)
scancart_test(test_stream SOURCES unit/test_stream.c support/site_sample.c DEPS sc_site sqlite3 LABELS unit)
scancart_test(test_site_rows SOURCES unit/test_site_rows.c support/site_sample.c DEPS sc_site LABELS unit)
scancart_test(prop_site_kill SOURCES prop/prop_site_kill.c support/site_sample.c DEPS sc_site LABELS prop TIMEOUT 120)
scancart_test(test_migrate SOURCES unit/test_migrate.c DEPS sc_site sqlite3 LABELS unit)
scancart_script_test(e2e_site COMMAND tests/e2e/site.sh LABELS e2e)
scancart_test(prop_site_power SOURCES prop/prop_site_power.c support/site_sample.c support/power_vfs.c
  DEPS sc_site sqlite3 LABELS prop TIMEOUT 120)
scancart_fuzz(site_db SOURCES fuzz/fuzz_site_db.c support/site_sample.c DEPS sc_site sqlite3)
add_executable(bench_site bench/bench_site.c support/site_sample.c)
target_link_libraries(bench_site PRIVATE sc_site)
scancart_script_test(e2e_site_verify COMMAND tests/e2e/site_verify.py --test LABELS e2e)
