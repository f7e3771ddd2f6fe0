# tests of capture
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
