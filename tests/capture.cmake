# tests of capture
scancart_test(test_capture_parts SOURCES unit/test_capture_parts.c DEPS sc_capture LABELS unit)
add_library(fake_cart STATIC support/fake_cart.c support/fake_scan.c)
target_link_libraries(fake_cart PUBLIC sc_capture sc_site sc_device fw_port_sim)
scancart_test(test_session SOURCES unit/test_session.c DEPS fake_cart sc_capture sc_site LABELS unit)
add_library(fast_cart STATIC support/fast_cart.c)
target_link_libraries(fast_cart PUBLIC sc_device sc_base)
scancart_test(test_session_threads SOURCES unit/test_session_threads.c
  DEPS fast_cart sc_capture sc_site pthread LABELS threads TIMEOUT 120)
scancart_test(prop_capture_kill SOURCES prop/prop_capture_kill.c DEPS fake_cart LABELS prop TIMEOUT 300)
scancart_test(prop_capture_writes SOURCES prop/prop_capture_writes.c support/power_vfs.c
  DEPS fake_cart sqlite3 LABELS prop TIMEOUT 300)
add_executable(bench_capture bench/bench_capture.c)
target_link_libraries(bench_capture PRIVATE fast_cart fake_cart)
# a process that dies needs no disk: what it has written stays
if(EXISTS /dev/shm)
  set_tests_properties(test_session prop_capture_kill prop_capture_writes PROPERTIES ENVIRONMENT "TMPDIR=/dev/shm")
endif()
scancart_script_test(e2e_capture COMMAND tests/e2e/capture.sh LABELS e2e slow TIMEOUT 300)
scancart_script_test(e2e_capture_faults COMMAND tests/e2e/capture_faults.py LABELS e2e slow TIMEOUT 300)
